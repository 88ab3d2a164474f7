"""What photographs of a code say of light, exposure and timing that did not stay: each sign, and none where all did."""

import re
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.consistency.check import check_gray_frames
from calibration.structured_light.consistency.unsteady import signs_of_unsteadiness
from calibration.structured_light.gray import gray_code_patterns

Frames = dict[str, np.ndarray]
SHAPE, SCALE, RIM = (48, 64), 5, 40
FULL = 4095


@pytest.fixture(scope="module")
def steady() -> Frames:
    """A textured wall around and under a picture, light that goes round, blur and noise; white and black last."""
    rng = np.random.default_rng(6)
    height, width = SHAPE[0] * SCALE + 2 * RIM, SHAPE[1] * SCALE + 2 * RIM
    row, column = np.mgrid[:height, :width]
    paint = 0.7 + 0.2 * np.sin(column / 23) * np.sin(row / 17) + 0.1 * (np.hypot(row - 150, column - 200) < 60)

    def photograph(codes: np.ndarray) -> np.ndarray:
        shown = np.pad(np.kron(codes / 255, np.ones((SCALE, SCALE))), RIM)
        light = cv2.GaussianBlur(paint * (0.1 + 0.6 * shown + 0.15 * shown.mean()), (0, 0), 0.8)
        return np.asarray((FULL * (light + rng.normal(0, 0.004, light.shape))).clip(0, FULL), np.uint16)

    coded = {pattern.name: photograph(pattern.codes) for pattern in gray_code_patterns(SHAPE)}
    white = np.full(SHAPE, 255, np.uint8)
    return {**coded, "white": photograph(white), "black": photograph(0 * white)}


def changed(frames: Frames, change: Callable[[int, np.ndarray], np.ndarray]) -> Frames:
    """Each photograph, by its number in time."""
    return {
        name: change(k, frame.astype(float)).clip(0, FULL).astype(np.uint16)
        for k, (name, frame) in enumerate(frames.items())
    }


def alone(frames: Frames) -> Frames:
    """Photographs without inverses."""
    return {name: frame for name, frame in frames.items() if not name.endswith("-inverse")}


@pytest.fixture(params=["with inverses", "without"])
def set_(request: pytest.FixtureRequest, steady: Frames) -> Frames:
    return steady if request.param == "with inverses" else alone(steady)


def test_a_steady_set_shows_nothing(set_: Frames) -> None:
    assert signs_of_unsteadiness(set_) == ()


def test_a_tone_curve_is_no_unsteadiness(set_: Frames) -> None:
    toned = changed(set_, lambda _, picture: FULL * (picture / FULL) ** (1 / 2.2))
    assert signs_of_unsteadiness(toned) == ()


def test_automatic_exposure_makes_black_brighter_than_white(set_: Frames) -> None:
    even = changed(set_, lambda _, picture: picture * 800 / picture.mean())
    sign, *_ = signs_of_unsteadiness(even)
    assert "black is brighter than white at" in sign
    assert "automatic" in sign


def test_a_lamp_that_was_switched_on_is_placed(set_: Frames) -> None:
    start = list(set_).index("gray-row-02")
    lit = changed(set_, lambda k, picture: picture + 0.1 * FULL * (k >= start))
    assert any("brighter from gray-row-02 on" in sign for sign in signs_of_unsteadiness(lit))


def test_lists_of_patterns_and_of_inverses_are_put_in_the_order_of_time(steady: Frames) -> None:
    """As manifests name them."""
    start = list(steady).index("gray-row-02")
    lit = changed(steady, lambda k, picture: picture + 0.1 * FULL * (k >= start))
    listed = dict(sorted(lit.items(), key=lambda item: item[0].endswith("-inverse")))
    assert signs_of_unsteadiness(listed) == signs_of_unsteadiness(lit)


def test_a_lamp_that_fades_is_told_with_its_darkest_and_brightest(set_: Frames) -> None:
    fading = changed(set_, lambda k, picture: picture * (1 - 0.3 * k / len(set_)))
    (sign,) = signs_of_unsteadiness(fading)
    assert re.search(r"gray-row-0[01] is darkest and gray-column-\d\d brightest", sign)


def test_bands_of_a_rolling_shutter_are_told(set_: Frames) -> None:
    rng = np.random.default_rng(1)

    def banded(_: int, picture: np.ndarray) -> np.ndarray:
        wave = np.sin(2 * np.pi * (np.arange(len(picture)) / 110 + rng.random()))
        return np.asarray(picture * (1 + 0.1 * wave[:, None]))

    assert any("along their lines" in sign for sign in signs_of_unsteadiness(changed(set_, banded)))


def test_exposures_that_began_too_early_show_the_pattern_before(set_: Frames) -> None:
    names = list(set_)
    mixed = changed(set_, lambda k, picture: 0.75 * picture + 0.25 * set_[names[max(k - 1, 0)]])
    sign, *_ = signs_of_unsteadiness(mixed)
    assert "also show the pattern before, by 2" in sign
    assert "wait longer" in sign


def test_a_torn_photograph_is_named_with_its_line(steady: Frames) -> None:
    """The lower part is already the next pattern's."""
    names = list(steady)
    torn = names.index("gray-column-02")
    line = 180
    frames = changed(
        steady,
        lambda k, picture: np.vstack([picture[:line], steady[names[k + 1]][line:]]) if k == torn else picture,
    )
    (sign,) = signs_of_unsteadiness(frames)
    assert "gray-column-02 and gray-column-02-inverse" in sign
    assert re.search(r"one side of a line 5\d % down", sign)


def test_a_camera_that_sinks_is_told_by_how_far(steady: Frames) -> None:
    def sunk(k: int, picture: np.ndarray) -> np.ndarray:
        move = np.array([[1, 0, 0], [0, 1, 3.0 * k / len(steady)]])
        return cv2.warpAffine(picture, move, picture.shape[::-1], borderMode=cv2.BORDER_REPLICATE)

    (sign,) = signs_of_unsteadiness(changed(steady, sunk))
    assert "the picture moves by 2." in sign
    assert "little by little" in sign


@pytest.mark.parametrize("line", [80, 180, 240])
@pytest.mark.parametrize("torn", ["gray-column-04", "gray-column-02", "gray-row-03"])
def test_a_torn_photograph_without_inverses_is_refused_for_edges_it_shares(
    steady: Frames, torn: str, line: int
) -> None:
    """Its lower part would give a strip of wrong points."""
    frames = alone(steady)
    following = list(frames)[list(frames).index(torn) + 1]
    frames[torn] = np.vstack([frames[torn][:line], frames[following][line:]])
    with pytest.raises(CalibrationError, match=r"have \d+ % of their edges in the same places") as refused:
        check_gray_frames(frames, 200)
    assert torn in str(refused.value)
    assert following in str(refused.value)
    assert "longer after the pattern was shown" in str(refused.value)


def test_whole_photographs_share_no_edges(set_: Frames) -> None:
    assert check_gray_frames(set_, 200).as_named


def test_finest_stripes_beyond_white_alone_are_put_down_to_sharpening(steady: Frames) -> None:
    frames = alone(steady)
    for name in ("gray-column-00", "gray-row-00"):
        picture = frames[name].astype(np.float32)
        frames[name] = (3 * picture - 2 * cv2.GaussianBlur(picture, (0, 0), 5)).clip(0, FULL).astype(np.uint16)
    with pytest.raises(CalibrationError, match=r"brighter than white .* the camera sharpens edges"):
        check_gray_frames(frames, 200)


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda frame: np.zeros_like(frame),
        lambda frame: np.full_like(frame, FULL),
        lambda frame: frame[:, ::-1],
        lambda frame: frame[:200],
    ],
    ids=["black", "saturated", "mirrored", "cropped"],
)
@pytest.mark.parametrize("name", ["gray-column-05", "gray-row-00", "white", "every one"])
def test_whatever_a_photograph_shows_it_can_be_asked(
    set_: Frames, name: str, spoilt: Callable[[np.ndarray], np.ndarray]
) -> None:
    """A refusal asks this on its way out, of photographs in which anything may be."""
    frames = {each: spoilt(frame) if name in (each, "every one") else frame for each, frame in set_.items()}
    assert all(isinstance(sign, str) and "nan" not in sign for sign in signs_of_unsteadiness(frames))


def test_photographs_of_nothing_show_nothing() -> None:
    nothing = {f"gray-row-0{k}": np.zeros((40, 60), np.uint8) for k in range(4)}
    assert signs_of_unsteadiness(nothing) == ()
