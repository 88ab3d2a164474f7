"""A device that goes away, or says nothing, is brought back within a limit, or named; no earlier frame is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest

from rig.capture.rig import Rig, open_rig
from rig.cli.app import run_command
from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.protocols import RawFrame
from rig.errors import (
    CaptureTimeout,
    DeviceBusy,
    DeviceError,
    DeviceForbidden,
    DeviceLost,
    SettingRefused,
)
from rig.files.journal import read_events
from rig.profile.schema import Profile
from rig.session import Session
from tests.rig.capture.fake_devices import LIMIT_S, WHITE, FakeCamera, FakeProjector, HungCamera, ResettableCamera

if TYPE_CHECKING:
    from pathlib import Path

    from tests.rig.conftest import Finished


@pytest.fixture
def profile(tiny_profile: Profile) -> Profile:
    timing = tiny_profile.timing.model_copy(update={"retries": 3, "timeout_s": 2.0, "replug_timeout_s": LIMIT_S})
    camera = tiny_profile.camera.model_copy(update={"driver": "v4l2", "device_id": "usb-1209:0001-A7"})
    projector = tiny_profile.projector.model_copy(update={"driver": "kms", "output": "HDMI-A-1"})
    return tiny_profile.model_copy(update={"timing": timing}).with_device(camera).with_device(projector)


@dataclass
class Bench:
    """A rig of fakes, open, its exposure set."""

    profile: Profile
    clock: VirtualClock = field(default_factory=lambda: VirtualClock(10.0))

    def __post_init__(self) -> None:
        self.camera = FakeCamera(self.clock)
        self.projector = FakeProjector(self.clock)
        self.rig = Rig(self.profile, self.camera, self.projector, self.clock)

    def use(self, camera: FakeCamera) -> FakeCamera:
        self.camera = camera
        self.rig = Rig(self.profile, camera, self.projector, self.clock)
        return camera

    def start(self) -> Rig:
        self.rig.open()
        self.rig.set_exposure(0.02)
        return self.rig

    @property
    def kinds(self) -> list[str]:
        return [event.kind for event in self.rig.events]

    def shoot(self) -> RawFrame:
        return self.rig.shoot(WHITE, name="white")

    @property
    def is_dark_and_closed(self) -> bool:
        return not self.camera.is_open and not self.projector.is_open and self.projector.calls[-1] == "close"


@pytest.fixture
def bench(profile: Profile) -> Bench:
    return Bench(profile)


def away_for(bench: Bench, seconds: float) -> tuple[float, float]:
    return bench.clock.now_s(), bench.clock.now_s() + seconds


class TestUnplugged:
    def test_a_camera_that_comes_back_goes_on_as_before(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = away_for(bench, 7.0)
        frame = bench.shoot()
        assert frame.exposure_s == 0.02, "the exposure was set again"
        assert frame.sequence == 1, "its count began anew, which is no repetition"
        assert 17.0 < frame.started_s < 18.5
        assert bench.projector.calls == ["open", "white", "white"], "the picture was shown again"
        assert bench.kinds == ["unplugged", "replugged"]
        assert bench.rig.events[0].detail == "camera usb-1209:0001-A7: it was unplugged"
        assert bench.shoot().sequence == 2

    def test_a_camera_that_goes_away_in_the_middle_of_a_frame_gives_another(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = (10.07, 12.0)
        assert bench.shoot().started_s > 12.0

    def test_a_projector_that_comes_back_shows_the_picture_again(self, bench: Bench) -> None:
        bench.start()
        bench.projector.away_s = away_for(bench, 3.0)
        assert bench.shoot().started_s > 13.0
        assert bench.projector.calls[-2:] == ["open", "white"]
        assert bench.rig.events[0].detail == "projector HDMI-A-1: it was unplugged"
        assert bench.camera.calls == ["open"], "the other device is left alone"

    def test_both_may_go_away_at_once(self, bench: Bench) -> None:
        bench.start()
        bench.projector.away_s, bench.camera.away_s = away_for(bench, 3.0), away_for(bench, 6.0)
        assert bench.shoot().started_s > 16.0
        assert bench.kinds == ["unplugged", "replugged"] * 2

    def test_it_is_waited_for_while_the_exposure_is_set_too(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = away_for(bench, 3.0)
        assert bench.rig.set_exposure(0.05) == 0.05
        bench.camera.away_s = away_for(bench, 3.0)
        assert bench.rig.shoot(WHITE, name="white", exposure_s=0.1).exposure_s == 0.1

    @pytest.mark.parametrize("which", ["camera", "projector"])
    def test_one_that_never_returns_is_named_within_the_limit(self, bench: Bench, which: str) -> None:
        bench.start()
        device = getattr(bench, which)
        device.away_s, device.close_fails = away_for(bench, 1e9), True
        began_s = bench.clock.now_s()
        named = {"camera": "camera usb-1209:0001-A7", "projector": "projector HDMI-A-1"}[which]
        with pytest.raises(DeviceLost, match=rf"{named} did not come back within 20 s \(timing.replug_timeout_s\)"):
            bench.shoot()
        assert began_s + LIMIT_S <= bench.clock.now_s() < began_s + LIMIT_S + 0.5
        assert bench.is_dark_and_closed
        assert 10 < device.calls.count("open") < 40

    def test_one_that_comes_and_goes_is_given_up_within_the_limit(self, bench: Bench) -> None:
        """Each return alone is in time."""
        bench.start()
        began_s = bench.clock.now_s()
        bench.camera.capture = lambda **_: (_ for _ in ()).throw(DeviceLost("a bad plug"))  # type: ignore[method-assign]
        with pytest.raises(DeviceLost, match="within 20 s"):
            bench.shoot()
        assert bench.clock.now_s() < began_s + LIMIT_S + 0.5
        assert bench.is_dark_and_closed

    def test_without_patience_it_is_named_at_once(self, bench: Bench) -> None:
        timing = bench.profile.timing.model_copy(update={"replug_timeout_s": 0.0})
        bench.rig.profile = bench.profile.model_copy(update={"timing": timing})
        bench.start()
        bench.camera.away_s = away_for(bench, 1.0)
        with pytest.raises(DeviceLost, match="it was unplugged"):
            bench.shoot()
        assert bench.clock.now_s() == 10.0

    def test_a_closed_rig_does_not_open_itself(self, bench: Bench) -> None:
        with pytest.raises(DeviceLost, match="it was unplugged"):
            bench.shoot()
        assert bench.camera.calls == bench.projector.calls == []

    def test_a_rig_that_gave_up_can_be_opened_again(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = away_for(bench, 60.0)
        with pytest.raises(DeviceLost):
            bench.shoot()
        bench.clock.wait_until_s(100.0)
        bench.start()
        assert bench.shoot().exposure_s == 0.02


class TestComesBackAsAnother:
    @pytest.mark.parametrize("refusal", [DeviceBusy("held by obs"), DeviceForbidden("add a udev rule")])
    def test_a_refusal_of_a_moment_is_waited_out(self, bench: Bench, refusal: DeviceError) -> None:
        """A device that was just plugged in belongs to root until the system has looked at it."""
        bench.start()
        bench.camera.away_s, bench.camera.refusals = away_for(bench, 1.0), [refusal]
        bench.shoot()
        assert bench.kinds == ["unplugged", "replugged"]

    def test_one_that_gives_no_frame_at_once_is_waited_for(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = away_for(bench, 1.0)
        bench.camera.refusals = [CaptureTimeout("it streams, but no frame came")] * 2
        assert bench.shoot().exposure_s == 0.02
        assert bench.kinds == ["unplugged", "replugged"]

    @pytest.mark.parametrize("refusal", [DeviceBusy("held by obs"), DeviceForbidden("add a udev rule")])
    def test_a_lasting_refusal_is_the_error(self, bench: Bench, refusal: DeviceError) -> None:
        bench.start()
        bench.camera.away_s, bench.camera.refusals = away_for(bench, 1.0), [refusal] * 99
        with pytest.raises(type(refusal), match=str(refusal)):
            bench.shoot()
        assert bench.clock.now_s() < 10.0 + 1.0 + 4.5
        assert bench.is_dark_and_closed

    def test_another_format_is_refused_at_once(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s = away_for(bench, 1.0)
        bench.camera.refusals = [SettingRefused("640 x 480, not 1280 x 720")]
        with pytest.raises(SettingRefused, match="640 x 480"):
            bench.shoot()
        assert bench.is_dark_and_closed

    def test_another_exposure_is_refused(self, bench: Bench) -> None:
        bench.start()
        bench.camera.away_s, bench.camera.rounding = away_for(bench, 1.0), 1.001
        with pytest.raises(SettingRefused, match=r"now exposes 0\.02002 s, not 0\.02 s as before"):
            bench.shoot()
        assert bench.is_dark_and_closed


class TestSilent:
    def test_first_it_is_asked_again_then_opened_again(self, bench: Bench) -> None:
        camera = bench.use(FakeCamera(bench.clock, cured_after=2))
        bench.start()
        assert bench.shoot().exposure_s == 0.02
        assert bench.kinds == ["timeout", "timeout", "reopened"]
        assert camera.calls == ["open", "close", "open"]

    def test_then_it_is_reset_and_waited_for(self, bench: Bench) -> None:
        camera = bench.use(ResettableCamera(bench.clock, cured_after=4))
        bench.start()
        assert bench.shoot().exposure_s == 0.02
        assert bench.kinds == ["timeout"] * 2 + ["reopened"] + ["timeout"] * 2 + ["reset", "unplugged", "replugged"]
        assert camera.calls.index("reset") > 2

    def test_a_camera_that_gives_no_frame_even_on_opening_is_reset(self, bench: Bench) -> None:
        bench.use(HungCamera(bench.clock))
        bench.start()
        assert bench.shoot().sequence == 1
        assert bench.shoot().exposure_s == 0.02
        assert bench.kinds == ["timeout", "timeout", "reopened", "timeout", "reset", "unplugged", "replugged"]

    def test_one_that_cannot_be_reset_is_opened_once_more(self, bench: Bench) -> None:
        camera = bench.use(ResettableCamera(bench.clock, cured_after=3, reset_fails=True))
        bench.start()
        bench.shoot()
        assert bench.kinds == ["timeout"] * 2 + ["reopened"] + ["timeout"] * 2 + ["failed"]
        assert bench.rig.events[-1].detail == "camera usb-1209:0001-A7 could not be reset: it is no USB device"
        assert camera.calls == ["open", "close", "open", "close", "open"]

    @pytest.mark.parametrize(("kind", "limit_s"), [(FakeCamera, 8.1), (ResettableCamera, 15.0)])
    def test_in_the_end_everything_that_was_tried_is_said(
        self, bench: Bench, kind: Callable[..., FakeCamera], limit_s: float
    ) -> None:
        bench.use(kind(bench.clock, cured_after=99))
        bench.start()
        with pytest.raises(CaptureTimeout) as caught:
            bench.shoot()
        said = str(caught.value)
        assert "attempts of 2 s (timeout)" in said
        assert "the camera was reopened" in said
        assert ("the camera was reset" in said) == (kind is ResettableCamera)
        assert bench.clock.now_s() <= 10.0 + limit_s
        assert bench.is_dark_and_closed

    def test_one_whose_stream_fails_is_opened_again_at_once(self, bench: Bench) -> None:
        camera = bench.use(FakeCamera(bench.clock, cured_after=2, failure=DeviceError("STREAMON: I/O error")))
        bench.start()
        assert bench.shoot().exposure_s == 0.02
        assert bench.kinds == ["failed", "reopened"]
        camera.cured_after = 99
        with pytest.raises(CaptureTimeout, match="STREAMON: I/O error"):
            bench.shoot()
        assert bench.is_dark_and_closed

    def test_a_frozen_camera_is_opened_again(self, bench: Bench) -> None:
        bench.use(FakeCamera(bench.clock, frozen=True, cured_after=2))
        bench.start()
        bench.shoot()
        bench.shoot()
        assert bench.kinds == ["repeated"] * 4 + ["reopened"]

    def test_one_that_stays_frozen_is_named(self, bench: Bench) -> None:
        bench.use(FakeCamera(bench.clock, frozen=True, cured_after=99))
        bench.start()
        bench.shoot()
        with pytest.raises(CaptureTimeout, match=r"\(repeated\).*the camera was reopened.*frozen\?"):
            bench.shoot()
        assert bench.is_dark_and_closed


@dataclass
class InterruptedClock(VirtualClock):
    """Ctrl-C at the n-th wait."""

    waits: int = 0

    def __post_init__(self) -> None:
        super().__init__(10.0)

    def wait_until_s(self, time_s: float) -> None:
        self.waits -= 1
        if self.waits == 0:
            raise KeyboardInterrupt
        super().wait_until_s(time_s)


def shoot_many(bench: Bench) -> None:
    bench.rig.set_exposure(0.02)
    for _ in range(30):
        bench.shoot()


@pytest.mark.parametrize("waits", range(1, 12))
def test_an_interruption_at_any_wait_leaves_everything_dark_and_closed(profile: Profile, waits: int) -> None:
    bench = Bench(profile, InterruptedClock(waits=waits))
    bench.camera.away_s, bench.projector.away_s = (10.05, 12.0), (12.5, 14.0)
    with pytest.raises(KeyboardInterrupt), bench.rig:
        shoot_many(bench)
    assert bench.is_dark_and_closed


def test_a_real_rig_runs_on_the_machines_clock_wherever_its_session_stopped(
    profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That clock begins anew with every start of the machine: an earlier time on it means nothing."""
    clock = VirtualClock()
    fakes = {"camera driver": FakeCamera(clock), "projector driver": FakeProjector(clock)}
    monkeypatch.setattr("rig.devices.drivers.made_by", lambda kind, *_, **__: fakes[kind])
    with open_rig(profile, resume_at_s=1e12) as rig:
        assert isinstance(rig.clock, SystemClock)
        assert rig.clock.now_s() < 1e12


# --- a whole session -----------------------------------------------------------------------------------------------


def with_faults(profile: Profile, folder: Path, *, camera: str = "", projector: str = "") -> Path:
    text = profile.raw.decode()
    for table, line in (("simulation.camera", camera), ("simulation.projector", projector)):
        text = text.replace(f"[[{table}]]\n", f"[[{table}]]\n{line}\n")
    path = folder / "faulty.toml"
    path.write_text(text)
    return path


def frames_of(folder: Path) -> list[tuple[str, str]]:
    return [(e["step"], e["name"]) for e in read_events(folder / "journal.jsonl") if e["event"] == "frame"]


def notes_of(folder: Path) -> list[str]:
    return [e["note"]["event"] for e in read_events(folder / "journal.jsonl") if e["event"] == "note"]


@pytest.mark.slow
def test_a_session_goes_on_at_the_missing_frame(tmp_path: Path, tiny_profile: Profile, finished: Finished) -> None:
    profile = with_faults(
        tiny_profile,
        tmp_path,
        camera="unplugged_s = [[3.01, 6.5], [14.0, 14.2]]\nfrozen_s = [[18.0, 90.0]]\nduplicate_frame_rate = 0.05",
        projector="unplugged_s = [[9.02, 11.0], [13.9, 15.0]]",
    )
    folder = tmp_path / "session"
    assert run_command(["run", str(folder), "-p", str(profile), "--json"]) == 0, "within its limits"
    frames = frames_of(folder)
    assert frames == frames_of(finished.folder), "the same frames, in the same order"
    assert len(frames) == len(set(frames)), "none twice"
    notes = notes_of(folder)
    assert notes.count("unplugged") == notes.count("replugged") == 4
    assert notes.count("reopened") == 1


def test_a_session_keeps_what_it_has_when_the_camera_never_returns(
    tmp_path: Path, tiny_profile: Profile, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = with_faults(tiny_profile, tmp_path, camera="unplugged_s = [[3.0, 1e6]]")
    folder = tmp_path / "session"
    assert run_command(["calibrate", str(folder), "-p", str(profile)]) == 3
    assert "did not come back within 20 s" in capsys.readouterr().err
    kept = frames_of(folder)
    assert len(kept) > 10
    assert notes_of(folder)[-1] == "unplugged"
    with Session.open(folder) as session:
        files = [event["file"] for event in session.frame_log() if event["event"] == "frame"]
        assert all((folder / file).is_file() for file in files)
