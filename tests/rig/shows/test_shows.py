"""A saved show is on at its times, comes back from whatever ends it, and obeys show control."""

import itertools
import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from pythonosc.osc_message_builder import OscMessageBuilder

from rig.cli.app import run_command
from rig.devices.clock import VirtualClock
from rig.devices.network.pjlink import Pjlink
from rig.errors import DeviceError, DeviceLost, ProfileError, RigError, UsageError
from rig.live.show.controls import Controls
from rig.shows.disk import keep_within
from rig.shows.keeper import ShowKeeper
from rig.shows.lamp import KeptLamp
from rig.shows.prepared import prepare_show
from rig.shows.remote import Desk, OscListener, Remote
from rig.shows.run import keep_show
from rig.shows.saved import load_show, request_of
from rig.shows.timetable import Timetable
from tests.rig.conftest import Finished
from tests.rig.devices.network.pjlink_emulator import EmulatedProjector, served

ROOT = Path(__file__).parents[3]
NOON = datetime(2026, 6, 1, 12, 0)


@dataclass
class Stage:
    """A keeper in virtual time, whose runs are scripted: a way to end, or an error, each after so many seconds."""

    script: list[tuple[float, str | RigError]]
    timetable: Timetable = field(default_factory=lambda: Timetable(()))
    ends_at_s: float = 1e9
    clock: VirtualClock = field(default_factory=VirtualClock)
    begun: list[tuple[float, float | None]] = field(default_factory=list)
    lit_s: float = 0.0
    offs: list[float] = field(default_factory=list)

    def play(self, seconds: float | None) -> str:
        self.begun.append((self.clock.now_s(), seconds))
        lasts_s, how = self.script.pop(0) if self.script else (1.0, "quit")
        self.clock.wait_until_s(self.clock.now_s() + (seconds if how == "time" and seconds else lasts_s))
        if isinstance(how, RigError):
            raise how
        return how

    def lit(self, seconds: float) -> None:
        self.lit_s += seconds

    def off(self) -> None:
        self.offs.append(self.clock.now_s())

    def keeper(self) -> ShowKeeper:
        return ShowKeeper(
            play=self.play,
            timetable=self.timetable,
            clock=self.clock,
            time_of_day=lambda: NOON + timedelta(seconds=self.clock.now_s()),
            is_ended=lambda: self.clock.now_s() >= self.ends_at_s,
            lamp=self,
        )


def test_failures_are_followed_by_longer_and_longer_pauses_up_to_eight_seconds() -> None:
    stage = Stage([(0.0, DeviceLost("gone"))] * 7)
    kept = stage.keeper().keep()
    begins = [begun for begun, _ in stage.begun]
    assert [b - a for a, b in itertools.pairwise(begins)] == [0.5, 1, 2, 4, 8, 8, 8]
    assert (kept.failures, kept.runs, kept.ended_by) == (7, 8, "quit")


def test_a_run_that_lasted_forgets_the_pauses_before_it() -> None:
    stage = Stage([(0.0, DeviceLost("gone"))] * 4 + [(100.0, DeviceError("again"))])
    stage.keeper().keep()
    assert stage.begun[-1][0] - (stage.begun[-2][0] + 100.0) == 0.5


def test_a_show_is_on_in_its_span_and_its_lamp_is_off_outside() -> None:
    stage = Stage([(0.0, "time"), (0.0, "time")], Timetable.of(("12:30-13:00",)))
    stage.keeper().keep()
    assert [begun for begun, _ in stage.begun][:2] == [1800.0, 1800.0 + 86400.0]
    assert stage.begun[0][1] == 1800.0
    assert stage.offs[0] == 0.0


def test_a_signal_while_the_show_is_off_ends_it_within_a_second() -> None:
    stage = Stage([], Timetable.of(("20:00-21:00",)), ends_at_s=100.0)
    assert stage.keeper().keep().ended_by == "signal"
    assert stage.clock.now_s() <= 101.0


def test_what_only_a_person_can_put_right_ends_the_first_run_and_no_later_one() -> None:
    with pytest.raises(UsageError):
        Stage([(0.0, UsageError("no such film"))]).keeper().keep()
    assert Stage([(1.0, "source"), (0.0, UsageError("film gone"))]).keeper().keep().failures == 2


@pytest.mark.parametrize(
    ("spans", "clock", "on", "left_s"),
    [
        (("09:00-18:00",), (8, 59), False, 60),
        (("09:00-18:00",), (9, 0), True, 9 * 3600),
        (("22:00-02:00",), (23, 30), True, 2.5 * 3600),
        (("22:00-02:00",), (2, 0), False, 20 * 3600),
        (("09:00-12:00", "12:00-24:00"), (10, 0), True, 14 * 3600),
    ],
)
def test_spans_of_a_day_may_cross_midnight(
    spans: tuple[str, ...], clock: tuple[int, int], on: bool, left_s: float
) -> None:
    timetable, now = Timetable.of(spans), datetime(2026, 6, 1, *clock)
    assert timetable.is_on(now) == on
    assert timetable.seconds_left(now) == left_s


@pytest.mark.parametrize("word", ["9-18", "25:00-26:00", "10:00-10:00", "10:00-24:30", "noon"])
def test_what_is_no_span_of_a_day_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match="is no span of a day"):
        Timetable.of((word,))


def test_commands_of_show_control_change_settings_and_nonsense_changes_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    remote, controls = Remote(), Controls(strategy="bounded")
    for address, values in (
        ("/rig/black", (1,)),
        ("/rig/gain", (0.5,)),
        ("/rig/freeze", (True,)),
        ("/rig/source/next", ()),
        ("/rig/gain", (float("nan"),)),
        ("/rig/gain", (1e9,)),
        ("/rig/black", ("x",)),
        ("/rig/black", ()),
        ("/rm", (1,)),
    ):
        remote.command(address, *values)
    changed = remote.adjusted(controls)
    assert (changed.black, changed.gain, changed.frozen) == (True, 0.5, True)
    assert remote.pressed() == "n"
    assert remote.adjusted(changed) == changed
    assert caplog.text.count("not understood") == 5


def send(port: int, datagram: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(datagram, ("127.0.0.1", port))


def osc(address: str, value: int | None = None) -> bytes:
    message = OscMessageBuilder(address)
    if value is not None:
        message.add_arg(value)
    return bytes(message.build().dgram)


def test_commands_arrive_over_the_network() -> None:
    remote = Remote()
    with OscListener(remote, "127.0.0.1", 0) as listener:
        for datagram in (osc("/rig/black", 1), b"\x00garbage", osc("/rig/source/next")):
            send(listener.port, datagram)
        arrived = threading.Event()
        for _ in range(200):
            if "n" in remote.pressed():
                break
            arrived.wait(0.02)
    assert remote.adjusted(Controls(strategy="bounded")).black


def test_a_port_that_is_taken_is_named() -> None:
    with OscListener(Remote(), "127.0.0.1", 0) as listener, pytest.raises(UsageError, match=str(listener.port)):
        OscListener(Remote(), "127.0.0.1", listener.port)


def test_recordings_lose_their_oldest_pictures_beyond_the_limit_and_no_journal(tmp_path: Path) -> None:
    for k in range(6):
        folder = tmp_path / f"run-{k // 3}"
        folder.mkdir(exist_ok=True)
        (folder / f"shown-{k:06d}.png").write_bytes(b"x" * 100)
        os.utime(folder / f"shown-{k:06d}.png", (1000 + k, 1000 + k))
        (folder / "journal.jsonl").write_bytes(b"x" * 1000)
    assert keep_within(tmp_path, 250) == 4
    assert sorted(path.name for path in tmp_path.glob("*/shown-*")) == ["shown-000004.png", "shown-000005.png"]
    assert len(list(tmp_path.glob("*/journal.jsonl"))) == 2


def test_lamp_hours_are_kept_and_the_limit_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "lamp.json"
    KeptLamp(path, None, 1.0).lit(3000)
    lamp = KeptLamp(path, None, 1.0)
    lamp.lit(1000)
    lamp.lit(1000)
    assert lamp.hours == pytest.approx(5000 / 3600)
    assert caplog.text.count("change it") == 1


def test_damaged_lamp_hours_end_no_show(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "lamp.json"
    path.write_text("{")
    assert KeptLamp(path, None, None).hours == 0
    assert "is damaged" in caplog.text


def test_the_lamp_is_switched_off_by_pjlink_and_one_that_is_silent_is_told(
    caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    with served(EmulatedProjector()) as projector:
        projector.state["1POWR"] = "1"
        control = Pjlink("127.0.0.1", projector.port)
        lamp = KeptLamp(tmp_path / "lamp.json", control, None)
        lamp.off()
        lamp.off()
        assert projector.commands.count("1POWR 0") == 1
    silent = KeptLamp(tmp_path / "other.json", control, None)
    silent.off()
    assert "the lamp stays lit" in caplog.text


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('sessoin = "runs/a"', "session"),
        ('session = "a"\non = ["9 to 5"]', "is no span of a day"),
        ('session = "a"\ngain = 9.0', "gain"),
    ],
)
def test_a_wrong_show_file_is_refused_with_each_problem(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "show.toml"
    path.write_text(text)
    with pytest.raises(ProfileError, match=match):
        load_show(str(path))


def test_a_show_without_a_session_and_one_that_is_not_there_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "show.toml"
    path.write_text("gain = 1.0")
    with pytest.raises(UsageError, match="neither a session nor a profile"):
        load_show(str(path))
    assert run_command(["live", "--show", "no-such-show"]) == 2
    assert run_command(["live", "runs/a", "--show", str(path)]) == 2


def test_paths_of_a_show_begin_at_its_file(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(b"")
    path = tmp_path / "show.toml"
    path.write_text('session = "runs/a"\nsources = ["film.mp4", "pattern"]')
    request = request_of(*load_show(str(path)))
    assert request.folder == tmp_path / "runs/a"
    assert request.sources == (str(tmp_path / "film.mp4"), "pattern")
    assert request.keeps_going
    assert request.endless


def test_a_saved_show_runs_until_a_signal_obeys_commands_and_writes_its_log(tmp_path: Path) -> None:
    path = tmp_path / "show.toml"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path.write_text(f'profile = "ci-tiny"\nstrategy = "none"\nrecord = "kept"\n[osc]\nport = {port}\n')
    lines: list[str] = []

    def told(line: str) -> None:
        lines.append(line)
        if len(lines) == 2:
            send(port, osc("/rig/black", 1))
        if "BLACK" in line or len(lines) > 40:
            os.kill(os.getpid(), signal.SIGTERM)

    kept = keep_show(str(path), on_status=told)
    assert (kept.ended_by, kept.signal, kept.exit_status) == ("signal", "SIGTERM", 143)
    assert "BLACK" in lines[-1]
    assert "ended by signal" in (tmp_path / "show.log").read_text()
    assert json.loads((tmp_path / "show.lamp.json").read_text())["lit_s"] > 0
    assert list((tmp_path / "kept").glob("*/journal.jsonl"))
    assert logging.getLogger("rig.shows").handlers == []


@pytest.mark.parametrize("changed", ["show.toml", "lab.toml", "session/maps/new.exr", "session/rechecks/001/x"])
def test_what_was_prepared_is_used_only_while_its_files_are_as_they_were(
    tmp_path: Path, finished: Finished, changed: str
) -> None:
    shutil.copytree(finished.folder, tmp_path / "session")
    shutil.copy(ROOT / "hw_profiles" / "ci-tiny.toml", tmp_path / "lab.toml")
    show = tmp_path / "show.toml"
    show.write_text('session = "session"\nprofile = "lab.toml"\n')
    prepared = prepare_show(str(show))
    assert prepared.plan.compensators
    assert prepared.is_current()
    path = tmp_path / changed
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.read_text() if path.exists() else ""
    path.write_text(before + "\n")
    assert prepared.is_current() == changed.endswith("001/x")  # a look that is no session takes no place


def test_what_an_operator_set_stays_when_the_show_begins_again() -> None:
    remote, fresh = Remote(), Controls(strategy="bounded")
    desk = Desk(remote)
    desk.begin()
    remote.command("/rig/black", 1)
    assert desk.adjusted(fresh).black
    assert not desk.adjusted(fresh).black  # a key at the terminal has its say while the show runs
    remote.command("/rig/black", 1)
    desk.adjusted(fresh)
    desk.begin()
    assert desk.adjusted(fresh).black


def test_a_short_soak_with_a_fault_a_minute_is_overcome() -> None:
    script = [sys.executable, str(ROOT / "benchmarks" / "show_soak.py"), "--hours", "0.2", "--seed", "3"]
    run = subprocess.run(script, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
