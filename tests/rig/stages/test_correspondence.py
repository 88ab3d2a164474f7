"""Step `gray` and `correspondence`: patterns as light, photographs as light, reasons in the report."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration import CODES, CalibrationError, Pattern, PixelReason
from calibration.radiometry.response import Response, linear_from_codes
from rig.errors import SessionError
from rig.plug_ins import find_code
from rig.report.pictures import REASONS
from rig.session import Session
from rig.stages import correspondence
from rig.stages.correspondence import _as_light, load_correspondence_figures
from rig.stages.light.black import black_light
from rig.stages.photograph import ExposureBracket, frame_name
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.reading import has_inverses, in_dn, in_light, read_code
from rig.stages.stripes.showing import CodePhotographs, blaming_focus
from rig.stages.stripes.stillness import read_standing
from rig.stages.stripes.superposition import superposition_percent
from rig.stages.stripes.width import ShownCode, as_named, shown_code

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

LEVELS = np.arange(256.0)
RESPONSES = tuple(Response(LEVELS, (LEVELS / 255) ** gamma, 0.0) for gamma in (1.8, 2.2, 2.6))


@pytest.fixture(params=[1, 3])
def responses(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[Response, ...]:
    chosen = RESPONSES[: request.param]
    monkeypatch.setattr(
        correspondence, "load_radiometric_calibration", lambda session: SimpleNamespace(projector=chosen)
    )
    return chosen


def test_grey_levels_of_a_code_are_shown_as_light(responses: tuple[Response, ...]) -> None:
    wanted = next(iter(CODES["three-frequency"].patterns((48, 64))))
    (shown,) = _as_light([wanted], session=None)  # type: ignore[arg-type]
    assert shown.name == wanted.name
    codes = shown.codes.reshape(48, 64, len(responses))
    for q, response in enumerate(responses):
        light = linear_from_codes(response, codes[..., q])
        assert np.abs(light - wanted.codes / 255).max() < 0.006


def test_black_and_white_are_shown_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(correspondence, "load_radiometric_calibration", None)
    pattern = Pattern("gray-column-00", np.array([[0, 255]], np.uint8))
    assert list(_as_light([pattern], session=None)) == [pattern]  # type: ignore[arg-type]


def test_the_response_is_looked_up_once_for_all_patterns(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def load(session: object) -> SimpleNamespace:
        asked.append(session)
        return SimpleNamespace(projector=RESPONSES)

    monkeypatch.setattr(correspondence, "load_radiometric_calibration", load)
    assert len(list(_as_light(CODES["three-frequency"].patterns((48, 64)), session=None))) == 24  # type: ignore[arg-type]
    assert len(asked) == 1


@pytest.mark.parametrize("name", sorted(CODES))
def test_codes_without_inverses_are_read_in_light(name: str) -> None:
    needs_light = name in ("gray-plain", "gray-phase", "three-frequency", "micro-phase")
    assert has_inverses(CODES[name].pattern_names((48, 64))) != needs_light


def test_a_stale_frame_of_a_session_is_refused_by_name(finished: "Finished") -> None:
    code = CODES["long-run"]
    with Session.read(finished.folder) as session:
        gray, radiometric = session.finished("gray"), load_radiometric_calibration(session)
        shape = session.profile.projector.shape
        frames = {
            name: gray.load_frame(frame_name(name)).pixels for name in ("white", "black", *code.pattern_names(shape))
        }
    assert read_code(code, frames.__getitem__, shape, radiometric).valid.mean() > 0.5
    late, before = code.pattern_names(shape)[7], code.pattern_names(shape)[6]
    with pytest.raises(CalibrationError, match=late.removesuffix("-inverse")):
        read_code(code, {**frames, late: frames[before]}.__getitem__, shape, radiometric)


def test_the_report_knows_every_reason() -> None:
    assert [reason.name.lower().replace("_", " ") for reason in PixelReason] == list(REASONS)


def test_what_geometry_is_refused_for_behind_a_blur_names_the_focus_first() -> None:
    error = CalibrationError("the surface is not flat")
    error.add_note("a note")
    with pytest.raises(CalibrationError, match=r"^the picture is out of focus .*3 times .* is not flat") as told:
        with blaming_focus(3):
            raise error
    assert told.value.__notes__ == ["a note"]


def test_what_geometry_is_refused_for_in_focus_is_left_as_it_is() -> None:
    error = CalibrationError("the surface is not flat")
    with pytest.raises(CalibrationError) as told, blaming_focus(1):
        raise error
    assert told.value is error


def test_what_a_mains_light_may_add_to_a_picture_is_below_the_limit_of_a_stripe(finished: "Finished") -> None:
    """At its brightest in one of a pair, at its darkest in the other: twice the amplitude."""
    with Session.read(finished.folder) as session:
        gray, radiometric = session.finished("gray"), load_radiometric_calibration(session)
        white, black = (gray.load_frame(frame_name(name)).pixels for name in ("white", "black"))
    swelling = replace(radiometric, black_swell={0.01: 0.0, 0.004: 0.3})
    for reading in (in_light, in_dn):
        plain, wider = (reading((white, black), each) for each in (radiometric, swelling))
        of_black = radiometric.table()[black].sum(axis=2)
        if reading is in_dn:
            of_black = np.maximum(black - radiometric.offset_dn, 0).sum(axis=2)
        assert wider.noise_limit - plain.noise_limit == pytest.approx(0.6 * of_black, rel=1e-4, abs=1e-6)


def black_frames(lights: list[float]) -> SimpleNamespace:
    """A step whose frames of black are each of one light."""
    frames = {
        frame_name("black", 0, k): SimpleNamespace(pixels=np.full((4, 6, 1), round(light), np.uint16))
        for k, light in enumerate(lights)
    }
    return SimpleNamespace(load_frame=frames.__getitem__)


def test_the_amplitude_of_a_mains_light_is_told_by_single_frames_a_third_of_its_period_apart() -> None:
    radiometric = SimpleNamespace(table=lambda: np.arange(4096.0), mosaic=None)
    lights = [1000 * (1 + 0.2 * np.cos(0.7 + 2 * np.pi * k / 3)) for k in range(6)]
    swelling = black_light(black_frames(lights), ExposureBracket((0.004,), 6, swell_hz=100.0), radiometric)  # type: ignore[arg-type]
    assert swelling.swell[0.004] == pytest.approx(0.2, rel=0.01)
    assert swelling.ripple[0.004] == pytest.approx(0.0, abs=0.002)
    assert swelling.mean[0.004] == pytest.approx(1000.0, rel=0.01)
    still = black_light(black_frames([1000.0, 1010.0] * 2), ExposureBracket((0.01,), 4), radiometric)  # type: ignore[arg-type]
    assert still.swell == {0.01: 0.0}
    assert still.ripple[0.01] == pytest.approx(0.0057, rel=0.02)


def test_light_adds_up_in_a_finished_session_and_one_pair_with_too_much_of_it_is_not_all(finished: "Finished") -> None:
    session = Session.read(finished.folder)
    gray = session.finished("gray")
    told = load_correspondence_figures(session).superposition_percent
    assert told is not None
    assert abs(told) < 0.5
    shown, radiometric = shown_code(session, gray), load_radiometric_calibration(session)

    def seen(change: Callable[[str], float]) -> float | None:
        """Of photographs that a device makes brighter."""

        def frame(name: str) -> NDArray[np.uint16]:
            pixels = gray.load_frame(frame_name(name)).pixels
            dark = np.median(gray.load_frame(frame_name("black")).pixels)
            return np.asarray(dark + change(name) * (pixels - dark), dtype=np.uint16)

        profile = session.profile
        by = CodePhotographs(profile=profile, radiometric=radiometric, take=list, frame=frame)
        return superposition_percent(by, shown)

    dimmed = seen(lambda name: 0.95 if name == "white" else 1.0)
    assert dimmed == pytest.approx(100 * (1 / 0.95 - 1), rel=0.15)
    first = shown.code.pattern_names(session.profile.projector.shape)[0]
    assert abs(seen(lambda name: 1.05 if name == first else 1.0) or 0) < 0.5


@pytest.fixture
def displaced(finished: "Finished") -> Callable[[int, float], CodePhotographs]:
    """Photographs of a finished session of which those from a number on are displaced by some pixels to the right."""
    session = Session.read(finished.folder)
    gray, profile = session.finished("gray"), session.profile
    names = ["white", "black", *find_code(profile.patterns.code).pattern_names(profile.projector.shape)]

    def photographs(first: int, px: float) -> CodePhotographs:
        def frame(name: str) -> NDArray[np.uint16]:
            pixels: NDArray[np.uint16] = gray.load_frame(frame_name("white" if name == "white-after" else name)).pixels
            if name in names[:first]:
                return pixels
            right = np.array([[1, 0, px], [0, 1, 0]], dtype=np.float64)
            return np.asarray(cv2.warpAffine(pixels, right, pixels.shape[1::-1])[..., None])

        radiometric = load_radiometric_calibration(session)
        return CodePhotographs(profile=profile, radiometric=radiometric, take=lambda _: None, frame=frame)

    return photographs


def _not_taken() -> NDArray[np.uint16]:
    raise SessionError("there is no such frame")


@pytest.mark.parametrize("pair", [0, 1, 9])
def test_stripes_that_are_displaced_are_refused_and_the_first_of_them_named(
    displaced: Callable[[int, float], CodePhotographs], pair: int
) -> None:
    first = 2 + 2 * pair
    by = displaced(first, 1.5)
    names = ["white", *as_named(by.profile).code.pattern_names(by.profile.projector.shape)[::2]]
    with pytest.raises(CalibrationError, match=rf"moved by \+1\.5 px .* between {names[pair]} and {names[pair + 1]},"):
        read_standing(by, as_named(by.profile))


def test_stripes_that_are_displaced_by_less_than_half_a_pixel_are_read(
    displaced: Callable[[int, float], CodePhotographs],
) -> None:
    by = displaced(12, 0.3)
    assert read_standing(by, as_named(by.profile)).valid.mean() > 0.4


def test_a_displacement_among_patterns_without_inverses_is_told_by_white_after_them(
    displaced: Callable[[int, float], CodePhotographs],
) -> None:
    still = displaced(99, 0.0)
    found = still.read(as_named(still.profile))
    code = SimpleNamespace(pattern_names=lambda shape: ("column-00",), decode=lambda *_, **__: found)
    shown = ShownCode(code=code, times=1)  # type: ignore[arg-type]
    frame = displaced(0, 1.5).frame
    by = replace(still, frame=lambda name: still.frame("black") if name == "column-00" else still.frame(name))
    assert read_standing(by, shown) is found
    earlier = replace(by, frame=lambda name: _not_taken() if name == "white-after" else by.frame(name))
    assert read_standing(earlier, shown) is found, "sessions of earlier versions have no white after"
    moved = replace(by, frame=lambda name: frame("white") if name == "white-after" else by.frame(name))
    with pytest.raises(CalibrationError, match=r"moved by \+1\.5 px .* between white and white-after"):
        read_standing(moved, shown)
