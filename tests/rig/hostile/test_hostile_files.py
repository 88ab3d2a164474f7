"""Three hundred files that went wrong: each is refused in words or taken, never a traceback, never a wrong answer.

Each test is one input: a file of a kind that the product reads, spoilt in one way by a fixed seed, and the command line
that reads it. Status 0 and 1 are answers, 2 to 4 and 20 to 24 refusals; any other end fails.
"""

import io
import json
import math
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from rig.errors import SessionCorrupt
from rig.files.exr import write_exr
from rig.live.sources import raw
from rig.session import Session
from tests.rig.conftest import Finished
from tests.rig.hostile.conftest import ANSWERS, Said
from tests.rig.hostile.mutations import mutated
from tests.rig.offline.test_scan import write_manifest, write_photographs

pytestmark = pytest.mark.timeout(60, func_only=True)
ROOT = Path(__file__).parents[3]


# Sessions


SESSION_FILES = (
    "calibration/*.json",
    "journal.jsonl",
    "session.json",
    "metrics.json",
    "profile.toml",
    "maps/*.exr",
    "images/*.exr",
    "frames/*/*.exr",
)


@pytest.fixture(scope="module")
def session(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy that each test spoils in one file, and mends again."""
    folder = tmp_path_factory.mktemp("spoilt") / "session"
    shutil.copytree(finished.folder, folder)
    return folder


@pytest.mark.parametrize("seed", range(112))
def test_a_session_with_a_spoilt_file_is_refused_or_the_step_is_done_again(
    rig: Callable[..., Said], session: Path, seed: int
) -> None:
    files = sorted(session.glob(SESSION_FILES[seed % len(SESSION_FILES)]))
    path = files[(seed // len(SESSION_FILES)) % len(files)]
    data = path.read_bytes()
    path.write_bytes(mutated(data, seed))
    try:
        planned = rig("run", session, "--dry-run", "--json")
        steps = json.loads(planned.out)["steps"] if planned.status == 0 else []
        noticed = planned.status == 4 or not all(step["done"] for step in steps)
        if path.name == "metrics.json":
            noticed = rig("report", session).status == 4
        if path.name == "truth-001.json":  # no step of the plan
            with pytest.raises(SessionCorrupt, match="truth"):
                Session.read(session).finished("truth")
            noticed = True
        is_same_header = path.name == "session.json" and header_of(path.read_bytes()) == header_of(data)
        assert noticed or is_same_header or is_torn_end(path, data), f"{path} was changed, and nobody noticed"
        if planned.status == 4:
            assert path.name in planned.err, "the message names the file"
    finally:
        path.write_bytes(data)


def header_of(data: bytes) -> object:
    """What session.json begins with; the rest is written anew from the journal."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return {key: value for key, value in found.items() if key != "steps"} if isinstance(found, dict) else None


def is_torn_end(path: Path, data: bytes) -> bool:
    """Whether only the end of the journal is missing after the last step: nothing that counts."""
    left = path.read_bytes()
    return path.name == "journal.jsonl" and left.splitlines()[:-1] == data.splitlines()[: len(left.splitlines()) - 1]


@pytest.mark.parametrize("name", ["comparison-001.json", "compensation-001.json"])
def test_a_digit_changed_in_a_record_is_computed_again_to_the_same_numbers(
    rig: Callable[..., Said], finished: Finished, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "session"
    shutil.copytree(finished.folder, folder)
    before = json.loads((folder / "metrics.json").read_bytes())
    path = folder / "calibration" / name
    text = path.read_text()
    k = next(k for k, sign in enumerate(text) if sign.isdigit() and sign != "9")
    path.write_text(text[:k] + "9" + text[k + 1 :])
    assert rig("report", folder).status == 4
    assert rig("run", folder, "--json").status in ANSWERS
    after = json.loads((folder / "metrics.json").read_bytes())
    assert after["comparison"] == before["comparison"]
    assert after["strategies"] == before["strategies"]


# Profiles


@pytest.mark.parametrize("seed", range(56))
def test_a_spoilt_profile(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    profiles = sorted((ROOT / "hw_profiles").glob("*.toml"))
    path = tmp_path / "profile.toml"
    path.write_bytes(mutated(profiles[(seed // 14) % len(profiles)].read_bytes(), seed))
    checked = rig("profile", "check", path)
    planned = rig("run", tmp_path / "new", "-p", path, "--dry-run")
    assert checked.status in (0, 2)
    assert (planned.status == 0) <= (checked.status == 0), "what is planned is a profile that holds"
    assert not (tmp_path / "new").exists()


# Photographs and manifests


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_photographs(folder)
    write_manifest(folder)
    return folder


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_manifest_or_photograph(
    rig: Callable[..., Said], photographs: Path, tmp_path: Path, seed: int
) -> None:
    names = ["replay.toml", *sorted(path.name for path in photographs.glob("*.png"))]
    path = photographs / names[0 if seed % 2 == 0 else 1 + seed % (len(names) - 1)]
    data = path.read_bytes()
    path.write_bytes(mutated(data, seed))
    try:
        scanned = rig("scan", photographs / "replay.toml", "-o", tmp_path / "cloud.ply", "--json")
    finally:
        path.write_bytes(data)
    if scanned.status == 0:
        assert all(math.isfinite(value) for value in json.loads(scanned.out).values() if isinstance(value, float))
    assert scanned.status in ANSWERS or not (tmp_path / "cloud.ply").exists(), (
        "no half cloud of a scan that was refused"
    )


# Meshes


def box_file(kind: str) -> bytes:
    box = trimesh.creation.box((2.0, 3.0, 2.5))
    box.invert()
    exported = box.export(file_type=kind)
    return exported.encode() if isinstance(exported, str) else bytes(exported)


@pytest.mark.parametrize("seed", range(42))
def test_a_spoilt_mesh(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    kind = ("obj", "ply", "glb")[seed // 14]
    path = tmp_path / f"room.{kind}"
    path.write_bytes(mutated(box_file(kind), seed))
    words = ("simulate", path, "--reflectance", "0.5", "--tolerance", "50", "--memory-mb", "500", "--json")
    simulated = rig(*words)
    if simulated.status == 0:
        actual = json.loads(simulated.out)["actual"]
        assert actual["energy_balance"] < 1e-2
        assert math.isfinite(actual["residual"])


# Pictures


def picture_file(kind: str) -> bytes:
    picture = np.random.default_rng(4).integers(0, 255, (192, 256, 3)).astype(np.uint8)
    return bytes(cv2.imencode(f".{kind}", picture)[1])


@pytest.mark.parametrize("seed", range(42))
def test_a_spoilt_target(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    kind = ("png", "jpg", "tiff")[seed // 14]
    path = tmp_path / f"target.{kind}"
    path.write_bytes(mutated(picture_file(kind), seed))
    rig("run", tmp_path / "new", "-p", "ci-tiny", "--dry-run", "--fit", "--target", path)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("seed", range(14))
def test_a_spoilt_target_of_light(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    path = tmp_path / "target.exr"
    write_exr(path, {"Y": np.full((192, 256), 0.5, np.float32)}, {"rig:name": "a name of some letters"})
    path.write_bytes(mutated(path.read_bytes(), seed))
    rig("run", tmp_path / "new", "-p", "ci-tiny", "--dry-run", "--target", path)


# Live sources


def stream(sizes: tuple[object, object]) -> bytes:
    return b"P6\n%s %s\n255\n" % tuple(str(size).encode() for size in sizes) + bytes(300)


STREAMS = (
    stream((99999, 99999)),
    stream((16384, 16384)),
    stream((16384, 1)),
    stream((1, 16384)),
    stream((0, 5)),
    stream((-3, 5)),
    stream(("9" * 40, 5)),
    stream((10, 10)),
    stream((1e3, 5)),
    b"P6\n",
    b"",
    b"\xff" * 300,
)


@pytest.mark.parametrize("k", range(len(STREAMS)))
def test_a_spoilt_stream_of_pictures(rig: Callable[..., Said], tmp_path: Path, k: int) -> None:
    path = tmp_path / "stream"
    path.write_bytes(STREAMS[k])
    shown = rig("live", "-p", "ci-tiny", "--strategy", "none", "--source", f"pipe:{path}", "--seconds", "0.2", "--json")
    assert shown.status in (0, 2, 24)


HEADERS = (
    (b"RIGFRAME", 16384, 16384, 2),
    (b"RIGFRAME", 2**32 - 1, 2**32 - 1, 2),
    (b"RIGFRAME", 16384, 1, 2),
    (b"RIGFRAME", 0, 0, 2),
    (b"RIGFRAME", 64, 48, 1),
    (b"NOTMINE!", 64, 48, 2),
)


@pytest.mark.parametrize("header", HEADERS)
def test_a_spoilt_shared_memory(
    rig: Callable[..., Said], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, header: tuple[bytes, int, int, int]
) -> None:
    folder = tmp_path / "shm"
    folder.mkdir()
    monkeypatch.setattr(raw.SharedMemorySource.__init__, "__defaults__", (folder,))
    (folder / "frames").write_bytes(struct.pack("<8sIIQ", *header).ljust(64, b"\0") + bytes(64))
    words = ("live", "-p", "ci-tiny", "--strategy", "none", "--source", "shm:frames", "--seconds", "0.2", "--json")
    assert rig(*words).status in (0, 2, 24)


@pytest.mark.parametrize("word", ["shm:.", "shm:..", "shm:a/b", "pipe:.", "camera:", "a" * 5000, ""])
def test_an_odd_word_for_a_source(rig: Callable[..., Said], word: str) -> None:
    shown = rig("live", "-p", "ci-tiny", "--strategy", "none", "--source", word, "--seconds", "0.2", "--json")
    assert shown.status in (2, 4, 22, 24)


@pytest.mark.parametrize("size", ["99999x99999", "16384x16384", "0x5", "²x5", "9" * 5000 + "x5", "x", "-1x-1", "1e9x2"])
def test_an_odd_size_of_raw_pictures(rig: Callable[..., Said], size: str) -> None:
    shown = rig("live", "-p", "ci-tiny", "--source", "pattern", f"--size={size}", "--seconds", "0.2", "--json")
    assert shown.status in (2, 24)


# Arguments


@pytest.mark.parametrize("option", ["--tolerance", "--grey-levels", "--memory-mb"])
@pytest.mark.parametrize("value", ["inf", "nan", "1e300", "1e-300", "0", "-1"])
def test_extreme_numbers_of_simulate_are_refused(rig: Callable[..., Said], option: str, value: str) -> None:
    said = rig("simulate", "corner", f"{option}={value}", "--json")
    assert said.status == 2
    assert said.out == ""


@pytest.mark.parametrize("size_m", [1e-12, 1e-6, 1e-3, 1e5, 1e100, 1e160, 1e200, 1e308])
def test_a_corner_of_a_size_that_no_room_has_is_refused(
    rig: Callable[..., Said], tmp_path: Path, size_m: float
) -> None:
    (tmp_path / "corner.obj").write_text(corner(size_m))
    said = rig("simulate", tmp_path / "corner.obj", "--reflectance", "0.7", "--json")
    assert said.status == 2
    assert "scale" in said.err


@pytest.mark.parametrize("size_m", [1e-12, 1e-9, 1e-6])
def test_a_tiny_corner_in_a_large_scene_is_left_out_and_said(
    rig: Callable[..., Said], tmp_path: Path, size_m: float
) -> None:
    far = "v 900 0 0\nv 901 0 0\nv 901 1 0\nv 900 1 0\nf 8 9 10 11\n"
    (tmp_path / "corner.obj").write_text(corner(size_m) + far)
    said = rig("simulate", tmp_path / "corner.obj", "--reflectance", "0.7", "--json")
    assert said.status == 0
    mended = [remark for remark in json.loads(said.out)["mesh"]["remarks"] if remark["outcome"] == "mended"]
    assert [(remark["kind"], remark["facets"]) for remark in mended] in ([("degenerate", 6)], [("tiny", 6)])


def corner(size_m: float) -> str:
    points = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1))
    written = io.StringIO()
    for point in points:
        written.write("v {!r} {!r} {!r}\n".format(*(size_m * value for value in point)))
    written.write("f 1 2 3 4\nf 1 5 6 2\nf 1 4 7 5\n")
    return written.getvalue()
