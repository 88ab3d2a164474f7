"""Thirty things that go wrong while a command runs: it ends in words, loses nothing, and the same command goes on."""

import contextlib
import errno
import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.cli.app import run_command
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import DeviceLost
from rig.files import atomic, journal
from rig.live.sources import files
from rig.offline import simulate
from rig.stages import compensation
from tests.rig.conftest import Finished
from tests.rig.offline.test_scan import write_manifest, write_photographs

pytestmark = pytest.mark.timeout(60, func_only=True)
RECORD = "calibration/compensation-001.json"


def failing(function: Callable[..., object], nth: int, error: BaseException) -> Callable[..., object]:
    """Return the function, failing once, at its n-th call."""
    left = iter(range(nth, -1, -1))

    def fails(*arguments: object, **options: object) -> object:
        if next(left, 1) == 0:
            raise error
        return function(*arguments, **options)

    return fails


@pytest.fixture(scope="module")
def begun(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session that lost the record of its pictures: they are to be computed again."""
    folder = tmp_path_factory.mktemp("begun") / "session"
    shutil.copytree(finished.folder, folder, ignore=shutil.ignore_patterns("frames"))
    shutil.copytree(finished.folder / "frames", folder / "frames", copy_function=os.link)
    return folder


def disk(number: int) -> OSError:
    return OSError(number, os.strerror(number))


PLACES = {"replace": (os, "replace"), "sync": (atomic, "sync"), "journal": (journal.Journal, "_write")}
NTH = {"replace": (0, 1, 3, 5), "sync": (0, 1, 3, 5), "journal": (0, 1, 0, 1)}
"""Of the calls that computing pictures again makes; the journal gets two lines."""
DISK_FAULTS = [
    (place, nth, number)
    for place in PLACES
    for nth, number in zip(NTH[place], (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS), strict=True)
]


@pytest.mark.parametrize(("place", "nth", "number"), DISK_FAULTS)
def test_a_disk_that_refuses_in_the_middle_of_a_step(
    begun: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    nth: int,
    number: int,
) -> None:
    before = files_of(begun)
    (begun / RECORD).unlink(missing_ok=True)
    owner, name = PLACES[place]
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, failing(getattr(owner, name), nth, disk(number)))
        status = run_command(["compensate", str(begun), "--json"])
    said = capsys.readouterr().err
    assert status == 4, said
    assert os.strerror(number) in said or "the disk is full" in said
    assert "the same command again" in said
    assert run_command(["compensate", str(begun), "--json"]) == 0
    assert files_of(begun) == before, "nothing was lost, and nothing else came"


def files_of(folder: Path) -> dict[str, bytes]:
    """Results by path; without what tells times and processes."""
    volatile = ("journal.jsonl", "lock", "session.json", "metrics.json", "report.html")
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name not in volatile]
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).digest() for path in paths}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MemoryError("of a test")])
@pytest.mark.parametrize("nth", [0, 3])
def test_an_interruption_and_a_lack_of_memory_between_two_pictures(
    begun: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: BaseException, nth: int
) -> None:
    before = files_of(begun)
    (begun / RECORD).unlink(missing_ok=True)
    with monkeypatch.context() as patch:
        patch.setattr(compensation, "solve", failing(compensation.solve, nth, error))
        is_key = isinstance(error, KeyboardInterrupt)
        with pytest.raises(KeyboardInterrupt) if is_key else contextlib.nullcontext():
            assert run_command(["compensate", str(begun)]) == 2
            assert "not enough memory: of a test" in capsys.readouterr().err
    assert run_command(["compensate", str(begun), "--json"]) == 0
    assert files_of(begun) == before


@pytest.mark.parametrize("name", ["maps", "images", "calibration"])
def test_a_folder_of_results_that_is_gone_is_named(
    begun: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    shutil.move(begun / name, tmp_path / name)
    try:
        assert run_command(["report", str(begun)]) in (0, 4)
        assert "Traceback" not in capsys.readouterr().err
    finally:
        shutil.rmtree(begun / name, ignore_errors=True)
        shutil.move(tmp_path / name, begun / name)


# Without a session


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    (tmp_path / "photographs").mkdir()
    write_photographs(tmp_path / "photographs")
    return write_manifest(tmp_path / "photographs")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_disk_that_refuses_a_point_cloud_keeps_the_old_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, photographs: Path, tmp_path: Path, number: int
) -> None:
    cloud = tmp_path / "cloud.ply"
    cloud.write_text("the cloud of yesterday")
    monkeypatch.setattr(os, "replace", failing(os.replace, 0, disk(number)))
    assert run_command(["scan", str(photographs), "-o", str(cloud)]) == 4
    assert str(cloud) in capsys.readouterr().err
    assert cloud.read_text() == "the cloud of yesterday"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cloud.ply", "photographs"]


def test_a_photograph_that_is_deleted_while_the_others_are_read(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, photographs: Path, tmp_path: Path
) -> None:
    from rig.devices.replay import photographs as replay

    read, last = replay.read_photograph, photographs.parent / "gray-row-06.png"

    def reads(path: Path) -> object:
        last.unlink(missing_ok=True)
        return read(path)

    monkeypatch.setattr(replay, "read_photograph", reads)
    assert run_command(["scan", str(photographs), "-o", str(tmp_path / "cloud.ply")]) == 3
    assert last.name in capsys.readouterr().err


@pytest.mark.parametrize(("error", "status"), [(MemoryError("of a test"), 2), (disk(errno.EIO), 4)])
def test_a_simulation_that_meets_a_limit_of_the_machine(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: BaseException, status: int
) -> None:
    monkeypatch.setattr(simulate, "simulate", failing(simulate.simulate, 0, error))
    assert run_command(["simulate", "corner", "--tolerance", "20", "--json"]) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "rig: " in captured.err


# Live


@pytest.fixture
def live(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, dict]]:
    def show(*words: object) -> tuple[int, dict]:
        command = ["live", "-p", "ci-tiny", "--strategy", "none", "--seconds", "1", "--json"]
        status = run_command([*command, *(str(word) for word in words)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, json.loads(captured.out) if captured.out else {"said": captured.err}

    return show


def test_a_display_that_goes_away_for_a_moment(
    live: Callable[..., tuple[int, dict]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ClockedDisplay, "show", failing_method(ClockedDisplay.show, 10, DeviceLost("unplugged")))
    status, told = live()
    assert status == 0
    assert told["unplugged"] == 1


@pytest.mark.parametrize("error", [MemoryError("of a test"), ValueError("of a decoder"), disk(errno.EIO)])
def test_a_source_whose_reader_fails_is_told_and_not_lost_in_a_thread(
    live: Callable[..., tuple[int, dict]], monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    monkeypatch.setattr(files.PatternSource, "read", failing_method(files.PatternSource.read, 5, error))
    status, told = live()
    assert status == 24
    assert told["ended_by"] == "source"
    assert str(error) in told["failure"]["message"]


def test_a_disk_that_is_full_ends_the_recording_and_not_the_show(
    live: Callable[..., tuple[int, dict]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(atomic, "sync", failing(atomic.sync, 4, disk(errno.ENOSPC)))
    status, told = live("--record", tmp_path / "recording")
    assert (status, told["ended_by"]) == (0, "time")
    assert any("recording stopped: the disk is full" in note for note in told["notes"])
    assert not list((tmp_path / "recording").glob("*.part"))


def failing_method(function: Callable[..., object], nth: int, error: BaseException) -> Callable[..., object]:
    """Return a method as :func:`failing` does; each call has its object."""
    fails = failing(function, nth, error)
    return lambda self, *arguments, **options: fails(self, *arguments, **options)
