"""What users get wrong: one or two lines on stderr, the right exit status, nothing written over."""

import errno
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.cli.app import run_command
from rig.files.atomic import write_atomic
from rig.files.exr import write_exr
from rig.files.pictures import write_png
from rig.profile.schema import Profile
from rig.session import Session

USAGE, DEVICE, SESSION, FAILED = 2, 3, 4, 1


class Said:
    """What a command line said, and how it ended."""

    def __init__(self, status: int, out: str, err: str):
        self.status, self.out, self.err = status, out, err

    @property
    def message(self) -> str:
        """The error without the lines that tell of progress."""
        assert "Traceback" not in self.err
        start = self.err.find("rig: ")
        assert start >= 0, self.err
        return self.err[start:].strip()


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]):
    def run(*words: object) -> Said:
        status = run_command([str(word) for word in words])
        captured = capsys.readouterr()
        return Said(status, captured.out, captured.err)

    return run


@pytest.fixture
def variant(tmp_path: Path, tiny_profile: Profile):
    """A profile like ci-tiny, with some texts replaced."""

    def write(name: str, *changes: tuple[str, str]) -> Path:
        text = tiny_profile.raw.decode()
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        return path

    return write


def expect(said: Said, status: int, *words: str) -> None:
    assert said.status == status, said.err
    assert len(said.message.splitlines()) <= 2, said.message
    for word in words:
        assert word in said.message
    assert said.out == ""


# Targets: all are refused before the session's folder is made, so before any frame.


def test_a_target_that_is_missing(rig, tmp_path: Path) -> None:
    said = rig("run", tmp_path / "new", "-p", "ci-tiny", "--target", tmp_path / "none.png")
    expect(said, USAGE, "none.png: no such file")
    assert not (tmp_path / "new").exists()


def test_a_target_that_is_no_picture(rig, tmp_path: Path) -> None:
    (tmp_path / "letter.png").write_text("Dear camera,\n")
    said = rig("run", tmp_path / "new", "-p", "ci-tiny", "--target", tmp_path / "letter.png")
    expect(said, USAGE, "letter.png: cannot be read", "PNG, JPEG, TIFF or EXR")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("verb", ["run", "compensate", "compare"])
def test_a_target_of_another_size_and_the_option_that_fits_it(rig, tmp_path: Path, verb: str) -> None:
    write_png(tmp_path / "small.png", np.full((10, 20), 99, np.uint8))
    said = rig(verb, tmp_path / "new", "-p", "ci-tiny", "--target", tmp_path / "small.png")
    expect(said, USAGE, "small.png: 20 x 10 px, but the projector has 256 x 192 px", "--fit")
    assert not (tmp_path / "new").exists()
    fitted = rig("run", tmp_path / "new", "-p", "ci-tiny", "--dry-run", "--fit", "--target", tmp_path / "small.png")
    assert fitted.status == 0


@pytest.mark.parametrize(
    ("shape", "value", "words"),
    [((192, 256), np.nan, "1 of 49152 values are NaN"), ((192, 256), -1.0, "negative"), ((8, 9), 0.5, "9 x 8 px")],
)
def test_an_exr_target_with_impossible_values_or_size(
    rig, tmp_path: Path, shape: tuple[int, int], value: float, words: str
) -> None:
    pixels = np.full(shape, 0.25, np.float32)
    pixels[3, 4] = value
    write_exr(tmp_path / "target.exr", {"Y": pixels})
    said = rig("run", tmp_path / "new", "-p", "ci-tiny", "--target", tmp_path / "target.exr")
    expect(said, USAGE, "target.exr", words)
    assert not (tmp_path / "new").exists()


def test_a_strategy_that_there_is_not(rig, tmp_path: Path) -> None:
    said = rig("run", tmp_path / "new", "-p", "ci-tiny", "--strategies", "none,magic")
    expect(said, USAGE, "unknown strategy magic; there are", "bounded")
    assert not (tmp_path / "new").exists()


# Profiles


def test_every_mistake_of_a_profile_is_told_at_once(rig, tmp_path: Path, variant) -> None:
    path = variant(
        "wrong",
        ("frame_rate_hz = 30.0", "frame_rate_fps = 30.0"),
        ("refresh_rate_hz = 60.0", 'refresh_rate_hz = "60 Hz"'),
        ("latency_s = 0.06 ", "latency_ms = 60 "),
    )
    said = rig("run", tmp_path / "new", "-p", path)
    assert said.status == USAGE
    for word in ("camera.frame_rate_fps", "projector.refresh_rate_hz", "projector.latency_ms", "latency_s"):
        assert word in said.message
    assert "Did you mean" in said.message or "did you mean" in said.message
    assert not (tmp_path / "new").exists()
    checked = rig("profile", "check", path, "hw_profiles/ci-tiny.toml")
    assert checked.status == USAGE
    assert "camera.frame_rate_fps" in checked.out
    assert "ci-tiny.toml: ok" in checked.out, "a broken file does not hide a good one"


def test_a_session_of_another_profile(rig, tmp_path: Path, tiny_profile: Profile, variant) -> None:
    folder = tmp_path / "session"
    with Session.open(folder, tiny_profile):
        pass
    before = {path: path.read_bytes() for path in folder.rglob("*")}
    other = variant("other", ('name = "ci-tiny"', 'name = "other"'))
    for words in (("-p", other), ("-p", other, "--dry-run")):
        expect(rig("run", folder, *words), SESSION, "was made with", "leave the profile out, or give a new folder")
    after = {path: path.read_bytes() for path in folder.rglob("*") if path.name != "lock"}
    assert after == {path: data for path, data in before.items() if path.name != "lock"}


def test_no_session_and_no_profile(rig, tmp_path: Path) -> None:
    expect(rig("run", tmp_path / "new"), SESSION, "there is no session here; name a profile to make one")
    expect(rig("report", tmp_path / "new"), SESSION, "no session")
    assert not (tmp_path / "new").exists()


def test_a_report_of_what_was_not_compared(rig, tmp_path: Path, tiny_profile: Profile) -> None:
    folder = tmp_path / "session"
    with Session.open(folder, tiny_profile) as session:
        expect(rig("report", folder), SESSION, "works on it since")
        session.write_metrics({"geometry": {"rms_px": 0.1}})
    expect(rig("report", folder), SESSION, "run `rig run")
    assert not (folder / "report.html").exists()


def test_a_folder_with_other_files_is_left_alone(rig, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("all I have")
    expect(rig("run", tmp_path / "full", "-p", "ci-tiny"), SESSION, "has other files (thesis.txt")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["thesis.txt"]


def test_a_second_process_on_a_session_names_the_first(rig, tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "session", tiny_profile):
        journal = (tmp_path / "session" / "journal.jsonl").read_bytes()
        said = rig("run", tmp_path / "session")
        expect(said, SESSION, f"process {os.getpid()} on", "works on it since", "wait for it to end")
        assert (tmp_path / "session" / "journal.jsonl").read_bytes() == journal
        assert rig("run", tmp_path / "session", "--dry-run").status == 0, "reading disturbs nobody"


# Photographs in the place of a camera


@pytest.fixture
def photographs(tmp_path: Path, tiny_profile: Profile) -> Path:
    """A folder of Gray-code photographs with a profile that replays them; returns the profile's path."""
    camera, projector = tiny_profile.camera, tiny_profile.projector
    rng = np.random.default_rng(5)
    folder = tmp_path / "photographs"
    folder.mkdir()
    lists = {key: [f"{key}{k}.png" for k in range(8)] for key in ("columns", "rows")}
    for name in [*lists["columns"], *lists["rows"], "white.png"]:
        cv2.imwrite(str(folder / name), rng.integers(0, 4000, camera.shape[:2]).astype(np.uint16))
    lens = "focal_px = [100, 100]\nprincipal_point_px = [100, 100]\n"
    (folder / "replay.toml").write_text(
        f"schema = 1\n[camera]\nwidth_px = {camera.width_px}\nheight_px = {camera.height_px}\n"
        f"full_scale_dn = 4095\n[camera.lens]\n{lens}"
        f"[projector]\nwidth_px = {projector.width_px}\nheight_px = {projector.height_px}\n[projector.lens]\n{lens}"
        "[projector_from_camera]\nrotation = [1, 0, 0, 0, 1, 0, 0, 0, 1]\ntranslation = [1, 0, 0]\nunit = 'm'\n"
        "[gray_code]\n" + "".join(f"{key} = {names}\n" for key, names in lists.items()) + "[frames]\n"
        'white = "white.png"\n'
    )
    text = tiny_profile.raw.decode()
    text = text[: text.index("[simulation]")].replace('driver = "simulated"', 'driver = "replay"')
    (folder / "profile.toml").write_text(f'{text}\n[replay]\nmanifest = "replay.toml"\n')
    return folder / "profile.toml"


def lose(folder: Path) -> None:
    (folder / "rows3.png").unlink()


def cut(folder: Path) -> None:
    data = (folder / "rows3.png").read_bytes()
    (folder / "rows3.png").write_bytes(data[: len(data) // 2])


def name_twice(folder: Path) -> None:
    manifest = folder / "replay.toml"
    manifest.write_text(manifest.read_text().replace("'rows4.png'", "'rows3.png'"))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lose, "rows3.png"),
        (cut, "rows3.png: is damaged"),
        (name_twice, "rows3.png: is named for gray-row-04 and for gray-row-03"),
    ],
)
def test_photographs_that_are_missing_cut_short_or_named_twice(
    rig, tmp_path: Path, photographs: Path, spoil, words: str
) -> None:
    spoil(photographs.parent)
    said = rig("run", tmp_path / "new", "-p", photographs)
    assert said.status == DEVICE
    assert words in said.message
    assert not (tmp_path / "new").exists(), "no session of a rig that did not open"
    scanned = rig("scan", photographs.parent / "replay.toml", "-o", tmp_path / "cloud.ply")
    assert scanned.status == DEVICE
    assert "rows3.png" in scanned.message
    assert not (tmp_path / "cloud.ply").exists()


def test_a_recording_that_ends_too_early_names_what_it_lacks(rig, tmp_path: Path, photographs: Path) -> None:
    said = rig("run", tmp_path / "new", "-p", photographs)
    expect(said, DEVICE, "the recording has no frame 'black'", "it has gray-column-00")


# Disks


def test_a_full_disk_says_what_to_do_and_the_session_goes_on_afterwards(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = 0

    def disk_of_twenty_files(path: Path, write, *, size_bytes: int = 0) -> None:
        nonlocal written
        written += 1

        def refuse(part: Path) -> None:
            part.write_bytes(b"the first half")
            raise OSError(errno.ENOSPC, "No space left on device")

        write_atomic(path, write if written < 20 else refuse, size_bytes=size_bytes)

    folder = tmp_path / "session"
    with monkeypatch.context() as patched:
        patched.setattr("rig.files.exr.write_atomic", disk_of_twenty_files)
        said = rig("calibrate", folder, "-p", "ci-tiny")
    expect(said, SESSION, "the disk is full: ", "MB are free", "free some space and run the same command again")
    assert not list(folder.rglob("*.part"))
    frames = {path: path.read_bytes() for path in folder.glob("frames/*/*.exr")}
    assert len(frames) == 19
    assert rig("calibrate", folder).status == 0
    assert all(path.read_bytes() == data for path, data in frames.items()), "nothing was lost"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 2 MB; only root can make one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", folder], capture_output=True, check=False)
    if made.returncode:
        pytest.skip("needs the right to mount a file system")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_real_full_disk(rig, small_disk: Path) -> None:
    folder = small_disk / "session"
    said = rig("calibrate", folder, "-p", "ci-tiny")
    expect(said, SESSION, "the disk is full: ", "free some space and run the same command again")
    subprocess.run(["mount", "-o", "remount,size=200m", small_disk], check=True)
    assert rig("calibrate", folder).status == 0
    assert not list(folder.rglob("*.part"))


# Scenes


def test_a_scene_without_light(rig, tmp_path: Path, variant) -> None:
    dark = variant("dark", ("flux = 10.0", "flux = 1e-6"))
    expect(rig("run", tmp_path / "new", "-p", dark), FAILED, "no light of the projector reaches the camera", "limit")
    expect(rig("check", "-p", dark), FAILED, "no light of the projector reaches the camera")


def test_a_camera_that_does_not_see_the_picture(rig, tmp_path: Path, variant) -> None:
    away = variant(
        "away",
        ("look_at_m = [4.60, 4.55, 1.12]", "look_at_m = [0.05, 0.02, 1.2]"),
        ("focal_px = 132.925", "focal_px = 300.0"),
    )
    expect(rig("run", tmp_path / "new", "-p", away), FAILED, "of the camera's pixels", "limit is 1 %", "aim the camera")


def test_a_camera_in_the_place_of_the_projector(rig, tmp_path: Path, variant) -> None:
    here = variant("here", ("position_m = [0.60, 1.42, 1.38]", "position_m = [1.00, 1.00, 1.20]"))
    expect(rig("run", tmp_path / "new", "-p", here), FAILED, "baseline", "limit")


# The wrong folder


def test_a_folder_that_is_no_session_is_told_with_the_whole_path_and_the_sessions_near_it(
    rig, tmp_path: Path, tiny_profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "Größe und Raum" / "mein Lauf"
    Session.open(folder, tiny_profile).close()
    monkeypatch.chdir(folder.parent)
    expect(rig("report", "mein lauf"), SESSION, f"there is no session here in {folder.parent} (near it: {folder})")
    expect(rig("report", "mein lauf"), SESSION, "make one with `rig run 'mein lauf' -p PROFILE`")
    expect(rig("run", "calibrated"), SESSION, f"(near it: {folder})", "name a profile")
    (folder / "frames").mkdir(exist_ok=True)
    for inner in ("frames", "session.json"):
        expect(rig("report", folder / inner), SESSION, f"is a part of the session {folder}; name that folder")
        expect(rig("run", folder / inner, "-p", "ci-tiny"), SESSION, "name that folder")
    monkeypatch.chdir(folder)
    expect(rig("report", "."), SESSION, "`rig run .` first")
    monkeypatch.chdir(tmp_path)
    expect(rig("report", "Größe und Raum/mein Lauf"), SESSION, "run `rig run 'Größe und Raum/mein Lauf'`")


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "paper-room", "--report"],
        ["check", "-p", "ci-tiny", "--report"],
        ["look", "-p", "ci-tiny", "-o"],
        ["bench", "plan", "--quick", "--csv"],
        ["compare-strategies", "--paper", "--report"],
    ],
)
def test_a_place_where_no_file_can_be_written_is_told_before_any_work(rig, tmp_path: Path, words: list[str]) -> None:
    said = rig(*words, tmp_path / "nowhere" / "file.html")
    expect(said, USAGE, f"there is no folder {tmp_path / 'nowhere'}; make it (mkdir -p")
    assert " done" not in said.err
    assert not (tmp_path / "nowhere").exists()
    said = rig(*words, tmp_path)
    expect(said, USAGE, "is a folder; give the name of a file in it")
