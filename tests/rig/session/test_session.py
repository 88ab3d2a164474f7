"""A session can be killed anywhere and goes on; it never loses, mixes or overwrites what it has."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.devices.protocols import RawFrame
from rig.errors import SessionCorrupt, SessionError, SessionLocked
from rig.files import journal
from rig.profile.schema import Profile
from rig.records import Record
from rig.session import Session
from tests.rig.session.small_session import frame_at, workflow


def test_frames_come_back_exactly(tmp_path: Path, tiny_profile: Profile) -> None:
    pixels = np.arange(48, dtype=np.uint16).reshape(4, 4, 3) * 1365
    frame = RawFrame(pixels=pixels, exposure_s=1 / 3, started_s=0.1 + 0.2, sequence=7)
    with Session.open(tmp_path / "s", tiny_profile) as session:
        session.step("white").save_frame("white", frame)
    with Session.open(tmp_path / "s") as session:
        back = session.step("white").load_frame("white")
        assert session.last_clock_s == frame.started_s + frame.exposure_s
    np.testing.assert_array_equal(back.pixels, frame.pixels)
    assert back.pixels.dtype == np.uint16
    assert (back.exposure_s, back.started_s, back.sequence) == (1 / 3, 0.1 + 0.2, 7)


def test_records_keep_every_digit(tmp_path: Path, tiny_profile: Profile) -> None:
    numbers = np.random.default_rng(3).normal(size=20)
    with Session.open(tmp_path / "s", tiny_profile) as session:
        step = session.step("fit")
        step.save_record("camera", {"focal": numbers, "count": np.int64(3), "pair": (np.float32(0.1), "x")})
        back = step.load_record("camera", dict)
        with pytest.raises(ValueError, match="JSON"):
            step.save_record("broken", {"rms": float("nan")})
    assert back["focal"] == numbers.tolist()
    assert back["pair"] == [float(np.float32(0.1)), "x"]


def test_other_settings_begin_a_new_run_that_overwrites_nothing(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        for run, level in enumerate((1.0, 2.0, 1.0), start=1):
            step = session.step("target", settings={"level": level})
            assert not step.done
            assert step.run_number == run
            assert not step.has_frame("white")
            step.save_frame("white", frame_at(level))
            step.save_image("target", {"Y": np.full((2, 2), level)})
            step.save_record("target", {"level": level})
            step.finish()
        assert session.finished("target").load_record("target", dict) == {"level": 1.0}
    names = {p.relative_to(tmp_path / "s").as_posix() for p in (tmp_path / "s").glob("*/**/*") if p.is_file()}
    assert names == {
        *(f"frames/target/000{k}.exr" for k in (0, 1, 2)),
        *(f"images/target-00{k}.exr" for k in (1, 2, 3)),
        *(f"calibration/target-00{k}.json" for k in (1, 2, 3)),
    }


def test_what_depends_on_a_changed_step_is_done_again(tmp_path: Path, tiny_profile: Profile) -> None:
    def dark_then_map(session: Session, level: float, note: str) -> bool:
        dark = session.step("dark", settings={"note": note})
        if not dark.done:
            dark.save_record("dark", {"level": level})
            dark.finish()
        maps = session.step("map", needs=["dark"])
        was_done = maps.done
        if not was_done:
            maps.finish()
        return was_done

    with Session.open(tmp_path / "s", tiny_profile) as session:
        assert not dark_then_map(session, 1.0, "a")
        assert dark_then_map(session, 1.0, "a")
        assert dark_then_map(session, 1.0, "b"), "other settings, but the same outputs"
        assert not dark_then_map(session, 2.0, "c")


def test_a_finished_step_is_not_written_to(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        step = session.step("black")
        step.save_frame("black", frame_at(1.0))
        step.finish()
        with pytest.raises(SessionError, match="step 'black' is finished"):
            step.save_frame("more", frame_at(2.0))


def test_a_missing_step_names_the_command_to_run(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        with pytest.raises(SessionError, match=r"step 'gray' has not been started; run `rig calibrate .*s` first"):
            session.finished("gray", verb="calibrate")
        session.step("gray")
        with pytest.raises(SessionError, match="step 'gray' is not finished"):
            session.step("map", needs=["gray"])
        with pytest.raises(SessionError, match="has no frame 'x'; it has none"):
            session.step("gray").load_frame("x")


def test_a_lost_file_is_repeated_and_nothing_else(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        workflow(session)
    (tmp_path / "s" / "frames" / "gray" / "0001.exr").unlink()
    with Session.open(tmp_path / "s") as session:
        with pytest.raises(SessionCorrupt, match=r"1 file of step 'gray', first frames/gray/0001\.exr; run `rig"):
            session.finished("gray")
        gray = session.step("gray", settings={"bits": [0, 1, 2]}, needs=["black"])
        assert not gray.done
        assert [gray.has_frame(f"gray-column-0{k}") for k in range(3)] == [True, False, True]
        workflow(session)
        assert session.finished("gray").frame_names == [f"gray-column-0{k}" for k in range(3)]


def test_a_changed_byte_is_found(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        workflow(session)
    path = tmp_path / "s" / "frames" / "gray" / "0001.exr"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with Session.open(tmp_path / "s") as session:
        with pytest.raises(SessionCorrupt, match=r"lost or damaged: 1 file of step 'gray', first frames/gray/0001"):
            session.finished("gray")
        gray = session.step("gray", settings={"bits": [0, 1, 2]}, needs=["black"])
        assert [gray.has_frame(f"gray-column-0{k}") for k in range(3)] == [True, False, True]
        with pytest.raises(
            SessionCorrupt, match=r"0001\.exr: is missing, or not as step 'gray' wrote it; run `rig run"
        ):
            gray.load_frame("gray-column-01")


def test_a_second_process_is_told_who_has_it(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile):
        with pytest.raises(SessionLocked, match=rf"process {os.getpid()} on \S+ works on it since 20\d\d-") as caught:
            Session.open(tmp_path / "s")
        assert caught.value.exit_code == 4
    Session.open(tmp_path / "s").close()


def test_a_killed_process_leaves_no_lock(tmp_path: Path, tiny_profile: Profile) -> None:
    code = (
        "import os, sys; from rig.session import Session; from rig.profile.schema import load_profile\n"
        "session = Session.open(sys.argv[1], load_profile(sys.argv[2]))\n"
        "session.step('black')\n"
        "open(os.path.join(sys.argv[1], 'session.json.part'), 'w').write('half')\n"
        "os.kill(os.getpid(), 9)\n"
    )
    died = subprocess.run([sys.executable, "-c", code, tmp_path / "s", tiny_profile.path], check=False)
    assert died.returncode == -9
    with Session.open(tmp_path / "s") as session:
        assert session.step("black").run_number == 1
        assert not list((tmp_path / "s").glob("*.part"))


def test_another_profile_is_refused_by_name_and_hash(tmp_path: Path, tiny_profile: Profile) -> None:
    Session.open(tmp_path / "s", tiny_profile).close()
    other = Profile.parse(tiny_profile.raw.replace(b'name = "ci-tiny"', b'name = "lab-b"'), Path("lab-b.toml"))
    with pytest.raises(SessionError) as caught:
        Session.open(tmp_path / "s", other)
    for part in (
        "'ci-tiny'",
        tiny_profile.sha256[:12],
        "'lab-b'",
        other.sha256[:12],
        "leave the profile out",
    ):
        assert part in str(caught.value)


def test_the_profile_is_an_exact_copy(tmp_path: Path, tiny_profile: Profile) -> None:
    Session.open(tmp_path / "s", tiny_profile).close()
    assert (tmp_path / "s" / "profile.toml").read_bytes() == tiny_profile.raw
    with Session.open(tmp_path / "s") as session:
        assert session.profile == tiny_profile
        assert session.profile.path == tiny_profile.path
    (tmp_path / "s" / "profile.toml").write_bytes(tiny_profile.raw + b"\n")
    with pytest.raises(SessionCorrupt, match=r"profile\.toml: is not the one that .*session\.json names"):
        Session.open(tmp_path / "s")


@pytest.mark.parametrize(
    ("schema", "message"),
    [
        (3, "layout 3 is newer than 2, the newest that this version reads; update procam-rig"),
        (1, "layout 1 was made with an older version of procam-rig; start a new session, or use version 0.1"),
    ],
)
def test_another_layout_is_refused(tmp_path: Path, tiny_profile: Profile, schema: int, message: str) -> None:
    Session.open(tmp_path / "s", tiny_profile).close()
    path = tmp_path / "s" / "session.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": schema}))
    for opened in (Session.open, Session.read):
        with pytest.raises(SessionError, match=message):
            opened(tmp_path / "s")


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": 2}', '{"schema": "2", "seed": 1}'])
def test_a_damaged_header_is_named(tmp_path: Path, tiny_profile: Profile, text: str) -> None:
    Session.open(tmp_path / "s", tiny_profile).close()
    path = tmp_path / "s" / "session.json"
    path.write_text(text)
    with pytest.raises(SessionCorrupt, match=r"session\.json: is damaged"):
        Session.open(tmp_path / "s")


def test_a_session_says_which_versions_made_it(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        assert session.versions["procam-rig"] == rig.__version__
        assert {"python", "numpy", "opencv"} <= session.versions.keys()
        (opened,) = session.events()
    assert opened["versions"] == session.versions


# Reading alone


def test_a_session_that_is_being_worked_on_can_be_read_and_not_written(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as owner:
        workflow(owner)
        before = {path: path.read_bytes() for path in (tmp_path / "s").rglob("*") if path.is_file()}
        with Session.read(tmp_path / "s", tiny_profile) as reader:
            assert reader.finished("gray").frame_names == owner.finished("gray").frame_names
            assert reader.is_done("gray", settings={"bits": [0, 1, 2]}, needs=["black"])
            assert not reader.is_done("gray", settings={"bits": [0, 1]}, needs=["black"])
            with pytest.raises(SessionError, match="was opened to read"):
                reader.note({"kind": "x"})
        assert {path: path.read_bytes() for path in before} == before


def test_a_step_that_was_not_finished_is_not_done(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        assert not session.is_done("black", settings={}, needs=())
        session.step("black")
        assert not session.is_done("black", settings={}, needs=())
        session.step("gray")
        assert not session.is_done("gray", settings={}, needs=["black"])


# Damage


@dataclass(frozen=True)
class Fit(Record):
    """A record as steps keep them."""

    third: float
    matrix: tuple[tuple[float, ...], ...]


def test_a_record_comes_back_as_what_it_was(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        workflow(session)
        assert session.finished("gray").load_record("fit", Fit).matrix == ((1.0, 0.0), (0.0, 1.0))


@pytest.mark.parametrize("text", ["{", '{"third": 0.5}', '{"third": "a", "matrix": []}'])
def test_a_record_that_is_not_what_it_should_be_is_damaged(tmp_path: Path, tiny_profile: Profile, text: str) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        workflow(session)
        step = session.finished("gray")
        path = tmp_path / "s" / "calibration" / "fit-001.json"
        path.write_text(text.ljust(_size_of(session, "fit-001.json")))
        with pytest.raises(SessionCorrupt, match=r"fit-001\.json: is missing, or not as step 'gray' wrote it"):
            step.load_record("fit", Fit)


def _size_of(session: Session, name: str) -> int:
    return next(int(event["size_bytes"]) for event in session.events() if event.get("file", "").endswith(name))


def test_a_damaged_journal_is_named_with_its_line(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        workflow(session)
    path = tmp_path / "s" / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    for damaged in (b"nonsense\n", b'{"event": "finish"}\n', b"3\n"):
        path.write_bytes(b"".join([*lines[:4], damaged, *lines[5:]]))
        with pytest.raises(SessionCorrupt, match=r"journal\.jsonl: line 5 is damaged"):
            Session.open(tmp_path / "s")


def test_folders_that_are_no_sessions_are_left_alone(tmp_path: Path, tiny_profile: Profile) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(SessionError, match=r"has other files \(thesis\.tex"):
        Session.open(tmp_path, tiny_profile)
    with pytest.raises(SessionError, match=r"thesis\.tex: is a file"):
        Session.open(tmp_path / "thesis.tex", tiny_profile)
    with pytest.raises(SessionError, match=r"no session here.*; make one with"):
        Session.open(tmp_path / "new")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_notes_and_frames_are_logged_in_order(tmp_path: Path, tiny_profile: Profile) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        step = session.step("black")
        session.note({"kind": "stale", "time_s": np.float64(0.5)})
        step.save_frame("black-0", frame_at(1.0), pattern="black", camera="left", projector="main")
    with Session.open(tmp_path / "s") as session:
        note, frame = session.frame_log()
    assert note["note"] == {"kind": "stale", "time_s": 0.5}
    details = {"pattern": "black", "exposure_s": 0.01 / 3, "started_s": 1.0, "sequence": 10, "signature": ""}
    details |= {"camera": "left", "projector": "main"}
    assert frame["frame"] == details


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "white space"])
def test_names_that_are_no_file_names_are_refused(tmp_path: Path, tiny_profile: Profile, name: str) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        with pytest.raises(ValueError, match="names are letters"):
            session.step(name)
        with pytest.raises(ValueError, match="names are letters"):
            session.step("ok").save_record(name, {})


def test_a_full_disk_leaves_the_journal_as_it_was(
    tmp_path: Path, tiny_profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        before = (tmp_path / "s" / "journal.jsonl").read_bytes()

        def half_then_full(self: journal.Journal, line: bytes) -> None:
            os.write(self._descriptor, line[:10])
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(journal.Journal, "_write", half_then_full)
            with pytest.raises(SessionError, match="the disk is full"):
                session.note({"kind": "x"})
        assert (tmp_path / "s" / "journal.jsonl").read_bytes() == before
        session.note({"kind": "y"})
    with Session.open(tmp_path / "s") as session:
        assert [e["note"] for e in session.frame_log()] == [{"kind": "y"}]


def test_a_session_goes_on_after_the_machine_was_started_again(tmp_path: Path, tiny_profile: Profile) -> None:
    """The clock of a real rig then begins anew; the order of frames is that of the journal."""
    with Session.open(tmp_path / "session", tiny_profile) as session:
        session.step("white").save_frame("before", frame_at(900_000.0))
    with Session.open(tmp_path / "session", tiny_profile) as session:
        assert session.last_clock_s > 900_000.0
        step = session.step("white")
        assert step.has_frame("before")
        step.save_frame("after", frame_at(12.0))
        step.finish()
        assert session.last_clock_s == pytest.approx(12.0, abs=0.1)
        assert step.frame_names == ["before", "after"]
        assert [event["name"] for event in session.frame_log()] == ["before", "after"]


def test_a_result_that_cannot_be_read_is_not_called_one_that_was_never_measured(
    tmp_path: Path, tiny_profile: Profile
) -> None:
    with Session.open(tmp_path / "s", tiny_profile) as session:
        session.write_metrics({"third": "of a calibration"})
        with pytest.raises(SessionError, match="nothing was compared yet"):
            session.read_metrics(Fit)
        session.step("compare").finish()
        with pytest.raises(SessionError, match=r"not as this version writes it: third: .* run `rig run"):
            session.read_metrics(Fit)
        file = tmp_path / "s" / "metrics.json"
        file.unlink()
        with pytest.raises(SessionError, match="is missing"):
            session.read_metrics(Fit)
        file.mkdir()
        with pytest.raises(SessionError, match="cannot be read: Is a directory"):
            session.read_metrics(Fit)
