"""A session that is killed at any moment, and run again, ends as one that nobody disturbed."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.files import atomic, journal
from rig.profile.schema import Profile
from rig.session import Session
from tests.rig.session.small_session import workflow


class Killed(BaseException):
    """Stands for SIGKILL: nothing may catch it."""


def final_files(folder: Path) -> dict[str, bytes]:
    """Everything whose bytes are promised: all but the journal, the lock and the volatile part."""
    files = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    summary = json.loads(files.pop("session.json"))
    del summary["volatile"]
    del files["journal.jsonl"], files["lock"]
    return files | {"session.json": json.dumps(summary).encode()}


def run_until_killed(folder: Path, profile: Profile) -> bool:
    """One process's life; True when it got to its end. The kernel frees a dead process's lock and files."""
    opened: list[Session] = []
    original = Session.__init__

    def remember(self: Session, *arguments: object, **keywords: object) -> None:
        original(self, *arguments, **keywords)  # type: ignore[arg-type]
        opened.append(self)

    Session.__init__ = remember  # type: ignore[method-assign,assignment]
    try:
        workflow(Session.open(folder, profile))
    except Killed:
        return False
    finally:
        Session.__init__ = original  # type: ignore[method-assign]
        for session in opened:
            session.close()
    return True


def kill_before_line(journal_file: journal.Journal, line: bytes) -> None:
    raise Killed


def kill_in_line(journal_file: journal.Journal, line: bytes) -> None:
    os.write(journal_file._descriptor, line[: len(line) // 2])
    raise Killed


def kill_after_line(journal_file: journal.Journal, line: bytes) -> None:
    os.write(journal_file._descriptor, line)
    raise Killed


@pytest.fixture
def uninterrupted(tmp_path: Path, tiny_profile: Profile) -> dict[str, bytes]:
    with Session.open(tmp_path / "whole", tiny_profile) as session:
        workflow(session)
    return final_files(tmp_path / "whole")


@pytest.mark.parametrize("kill", [kill_before_line, kill_in_line, kill_after_line])
def test_killed_at_any_journal_line_it_ends_with_the_same_bytes(
    tmp_path: Path,
    tiny_profile: Profile,
    uninterrupted: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
    kill: Callable[[journal.Journal, bytes], None],
) -> None:
    write = journal.Journal._write
    lines = len((tmp_path / "whole" / "journal.jsonl").read_bytes().splitlines())
    assert lines == 14
    for k in range(lines):
        countdown = iter(range(k, -1, -1))

        def write_or_die(
            self: journal.Journal,
            line: bytes,
            left: "iter[int]" = countdown,  # type: ignore[valid-type]
        ) -> None:
            kill(self, line) if next(left, 1) == 0 else write(self, line)

        folder = tmp_path / f"killed-{k}"
        with monkeypatch.context() as patch:
            patch.setattr(journal.Journal, "_write", write_or_die)
            assert not run_until_killed(folder, tiny_profile)
        assert run_until_killed(folder, tiny_profile)
        assert final_files(folder) == uninterrupted, f"killed at line {k}"


def test_killed_at_any_write_to_the_disk_it_ends_with_the_same_bytes(
    tmp_path: Path, tiny_profile: Profile, uninterrupted: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    sync, k, finished = atomic.sync, 0, False
    while not finished:
        left = [k]

        def sync_or_die(path: Path, left: list[int] = left) -> None:
            left[0] -= 1
            if left[0] == -1:
                raise Killed
            sync(path)

        folder = tmp_path / f"killed-{k}"
        with monkeypatch.context() as patch:
            patch.setattr(atomic, "sync", sync_or_die)
            finished = run_until_killed(folder, tiny_profile)
        assert run_until_killed(folder, tiny_profile)
        assert final_files(folder) == uninterrupted, f"killed at write {k}"
        k += 1
    assert k > 20


def test_killed_again_and_again_it_still_ends_with_the_same_bytes(
    tmp_path: Path, tiny_profile: Profile, uninterrupted: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    write, lives = journal.Journal._write, 0
    finished = False
    while not finished:
        left = [3]

        def write_or_die(self: journal.Journal, line: bytes, left: list[int] = left) -> None:
            left[0] -= 1
            if left[0] == 0:
                kill_in_line(self, line)
            write(self, line)

        with monkeypatch.context() as patch:
            patch.setattr(journal.Journal, "_write", write_or_die)
            finished = run_until_killed(tmp_path / "killed", tiny_profile)
        lives += 1
    assert lives > 5
    assert final_files(tmp_path / "killed") == uninterrupted


def test_a_finished_session_changes_nothing_when_run_again(tmp_path: Path, tiny_profile: Profile) -> None:
    for _ in range(2):
        with Session.open(tmp_path / "s", tiny_profile) as session:
            workflow(session)
            log = session.frame_log()
    assert [e["name"] for e in log] == ["black-0", "black-1", *(f"gray-column-0{k}" for k in range(3))]
