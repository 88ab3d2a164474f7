"""Frames that are not what they are called, on arrays: which pictures a check finds, and what it says."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.consistency.check import check_gray_frames
from calibration.structured_light.consistency.complements import refuse_stale_frames
from calibration.structured_light.consistency.edges import LinePlaces, stripes_of
from calibration.structured_light.consistency.readings import Slots, as_named, evidence_of
from calibration.structured_light.consistency.still import exposure_gains, exposure_gains_alone, movements
from calibration.structured_light.gray import CodeName, gray_code_patterns
from calibration.structured_light.patterns import flat

SHAPE = (48, 64)
SCALE = 5
"""Camera pixels along a projector pixel."""


def frames_of(code: CodeName = "gray", seed: int = 1) -> dict[str, np.ndarray]:
    """A textured wall, lit by a code, with noise."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[: SHAPE[0] * SCALE, : SHAPE[1] * SCALE]
    texture = 1 + 0.3 * np.sin(column / 17) * np.sin(row / 11) + 0.2 * (np.hypot(row - 90, column - 200) < 40)
    return {
        pattern.name: (
            texture * (12 + 0.4 * np.kron(pattern.codes, np.ones((SCALE, SCALE)))) + rng.normal(0, 1, row.shape)
        )
        .clip(0, 255)
        .astype(np.uint8)
        for pattern in gray_code_patterns(SHAPE, code=code)
    }


@pytest.fixture(scope="module")
def frames() -> dict[str, np.ndarray]:
    return frames_of()


def test_right_frames_may_be_what_they_are_called(frames: dict[str, np.ndarray]) -> None:
    order = check_gray_frames(frames, 10)
    assert order.as_named
    assert all(name == given for name, given in order.readings[0].items())
    assert order.gains == {}
    assert order.unresolved == ()


def test_what_the_pictures_leave_open_is_the_coarsest_sides_and_the_axes(frames: dict[str, np.ndarray]) -> None:
    """Eight readings: columns and rows exchanged, either of them mirrored."""
    order = check_gray_frames(frames, 10)
    assert len(order.readings) == 8
    finest = {reading["gray-column-00"] for reading in order.readings}
    assert finest == {"gray-column-00", "gray-row-00"}


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("gray-column-04", "gray-column-02"),
        ("gray-row-01", "gray-row-00"),
        ("gray-row-02-inverse", "gray-column-03"),
        ("gray-column-01", "gray-column-01-inverse"),
    ],
)
def test_exchanged_frames_are_found_by_what_they_show(frames: dict[str, np.ndarray], a: str, b: str) -> None:
    order = check_gray_frames({**frames, a: frames[b], b: frames[a]}, 10)
    changed = {name: given for name, given in order.readings[0].items() if name != given}
    assert not order.as_named
    assert changed == {a: b, b: a}


def test_frames_of_another_code_are_refused() -> None:
    frames = {name.replace("long-run", "gray"): frame for name, frame in frames_of("long-run").items()}
    with pytest.raises(CalibrationError, match="no order of the photographs explains their stripes"):
        check_gray_frames(frames, 10)


def test_dark_frames_tell_nothing_and_are_left_to_the_decoder(frames: dict[str, np.ndarray]) -> None:
    dark = {name: np.full_like(frame, 12) for name, frame in frames.items()}
    assert check_gray_frames(dark, 10).as_named


@pytest.mark.parametrize("late", [1, 6, 13, 23])
def test_a_jump_of_the_picture_is_found_and_measured(frames: dict[str, np.ndarray], late: int) -> None:
    moved = [np.roll(f, 20, axis=1) if k >= late else f for k, f in enumerate(frames.values())]
    found = movements([(moved[k], moved[k + 1]) for k in range(0, len(moved), 2)])
    assert found
    assert max(m.step_px for m in found) == pytest.approx(20, abs=3)
    assert min(abs(m.after - late) for m in found) <= 1


def test_a_still_picture_does_not_jump(frames: dict[str, np.ndarray]) -> None:
    still = list(frames.values())
    assert movements([(still[k], still[k + 1]) for k in range(0, len(still), 2)]) == ()


def test_the_exposure_of_one_frame_is_found_from_what_its_pair_lacks(frames: dict[str, np.ndarray]) -> None:
    values = np.stack([frame.ravel()[::7] for frame in frames.values()]).astype(np.float64)
    values[5] *= 0.5
    gains = exposure_gains(values, [(k, k + 1) for k in range(0, len(values), 2)])
    assert gains[5] == pytest.approx(0.5, abs=0.05)
    assert (np.delete(gains, 5) == 1).all()


def without_inverses(frames: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: frame for name, frame in frames.items() if not name.endswith("-inverse")}


@pytest.mark.parametrize("gain", [0.5, 0.7, 1.6])
def test_the_exposure_of_a_frame_without_inverse_is_found_from_the_two_levels_of_every_place(
    frames: dict[str, np.ndarray], gain: float
) -> None:
    plain = without_inverses(frames)
    values = np.stack([frame.ravel()[::7] for frame in plain.values()]).astype(np.float64)
    assert (exposure_gains_alone(values) == 1).all()
    for k in range(len(values)):
        changed = values.copy()
        changed[k] *= gain
        gains = exposure_gains_alone(changed)
        assert gains[k] == pytest.approx(gain, rel=0.1)
        assert (np.delete(gains, k) == 1).all()


@pytest.mark.parametrize("name", ["gray-column-01", "gray-row-01", "gray-column-04"])
def test_the_exposure_of_blurred_stripes_in_a_room_that_is_not_dark_is_found(
    frames: dict[str, np.ndarray], name: str
) -> None:
    """Blur leaves the second finest stripes three quarters of their contrast."""
    blurred = {n: 40 + cv2.GaussianBlur(f, (0, 0), 2.2).astype(np.float64) for n, f in without_inverses(frames).items()}
    values = np.stack([frame.ravel()[::7] for frame in blurred.values()])
    assert (exposure_gains_alone(values) == 1).all()
    k = list(blurred).index(name)
    values[k] *= 0.5
    gains = exposure_gains_alone(values)
    assert gains[k] == pytest.approx(0.5, abs=0.05)
    assert (np.delete(gains, k) == 1).all()


def test_stripes_that_are_all_blur_are_not_taken_for_another_exposure(frames: dict[str, np.ndarray]) -> None:
    values = np.stack([frame.ravel()[::7] for frame in without_inverses(frames).values()]).astype(np.float64)
    values[-1] = (values.min(axis=0) + values.max(axis=0)) / 2
    assert (exposure_gains_alone(values) == 1).all()


def test_the_exposure_of_a_frame_is_found_where_the_view_lies_within_a_wide_stripe(
    frames: dict[str, np.ndarray],
) -> None:
    view = {name: frame[:, : frame.shape[1] * 2 // 5] for name, frame in frames.items()}
    for name in view:
        found = check_gray_frames({**view, name: (view[name] * 0.5).astype(view[name].dtype)}, 9.0)
        assert found.gains.get(name, 0.5) == pytest.approx(0.5, abs=0.06), "or too dark to have an exposure"
        assert set(found.gains) <= {name}


def lit_by_few_rows(tone: float, around: float) -> dict[str, np.ndarray]:
    """A projector of 33 rows: of its coarsest stripes one row is lit. Light goes round from all, and a curve bends."""
    rng, shape = np.random.default_rng(4), (33, 48)
    found = {}
    for pattern in gray_code_patterns(shape):
        lit = cv2.GaussianBlur(np.kron(pattern.codes / 255.0, np.ones((4, 4))), (0, 0), 1.5)
        light = (0.2 + 0.3 * lit + around * lit.mean()) / (0.5 + around)
        found[pattern.name] = np.rint(4095 * light ** (1 / tone) + rng.normal(0, 4, light.shape)).clip(0, 4095)
    return {name: frame.astype(np.uint16) for name, frame in found.items()}


@pytest.mark.parametrize(("tone", "around"), [(1.0, 0.0), (1.0, 1.0), (2.2, 0.0), (2.2, 1.0)])
def test_a_picture_that_is_dark_nearly_everywhere_and_its_inverse_are_a_pair(tone: float, around: float) -> None:
    """Refused before as no pair, or scaled as another exposure: drawn set 881042 of `benchmarks/photographs`."""
    found = check_gray_frames(lit_by_few_rows(tone, around), 40)
    assert found.as_named
    assert found.gains == {}


def test_a_bump_in_a_code_without_inverses_is_seen_where_stripes_are_brighter_than_white() -> None:
    """Moved along the stripes codes stay the same, but at the ends of things: drawn set 881021."""
    stripes = {name: frame for name, frame in without_inverses(frames_of()).items() if "column" in name}
    shadow = np.ones((SHAPE[0] * SCALE, SHAPE[1] * SCALE))
    shadow[60:140, 80:200] = 0.15
    rng = np.random.default_rng(5)
    flats = {"white": np.full(shadow.shape, 114.0), "black": np.full(shadow.shape, 12.0)}
    still = {
        name: (shadow * frame + rng.normal(0, 1, shadow.shape)).clip(0, 255).astype(np.uint8)
        for name, frame in {**flats, **stripes}.items()
    }
    still["white"] = np.maximum.reduce(list(still.values()))
    assert check_gray_frames(still, 10).as_named
    late = list(still)[4:]
    bumped = {name: np.roll(frame, 20, axis=0) if name in late else frame for name, frame in still.items()}
    with pytest.raises(CalibrationError, match=r"gray-column-03.*brighter than white or darker than black.*bumped"):
        check_gray_frames(bumped, 10)


def session_of(code: CodeName, *, blur_px: float = 0.0, glow: float = 0.0, drift: float = 0.0) -> dict[str, np.ndarray]:
    """White, black and a code in linear light: blurred, with light off other walls, of a lamp that drifts."""
    rng = np.random.default_rng(2)
    flats = [flat(SHAPE, 255, "white"), flat(SHAPE, 0, "black")]
    frames = {}
    for k, pattern in enumerate([*flats, *gray_code_patterns(SHAPE, code=code)]):
        light = np.kron(pattern.codes, np.ones((SCALE, SCALE))) / 255
        light = cv2.GaussianBlur(light, (0, 0), blur_px) if blur_px else light
        seen = 20 + 150 * (1 - drift * k) * (light + glow * light[:, : light.shape[1] // 2].mean())
        frames[pattern.name] = seen + rng.normal(0, 1, light.shape)
    return frames


def refuse_stale(frames: dict[str, np.ndarray]) -> None:
    refuse_stale_frames(frames, 2 * 2**0.5, 500)


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
def test_stale_frames_of_a_session_are_refused_by_name(code: CodeName) -> None:
    frames = session_of(code, glow=0.8)
    refuse_stale(frames)
    names = list(frames)[2:]
    for before, name in list(pairwise(names))[::3]:
        for shown in (before, "black"):
            with pytest.raises(CalibrationError, match=f"{name.removesuffix('-inverse')} .*stale frame"):
                refuse_stale({**frames, name: frames[shown]})


@pytest.mark.parametrize(("name", "shown"), [("white", "long-run-column-03"), ("black", "long-run-column-03-inverse")])
def test_stale_frames_of_white_and_black_are_told_from_those_of_patterns(name: str, shown: str) -> None:
    frames = session_of("long-run", glow=0.8)
    with pytest.raises(CalibrationError, match=r"^white and black do not add up"):
        refuse_stale({**frames, name: frames[shown]})


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
@pytest.mark.parametrize("change", [{"blur_px": 9.0}, {"glow": 3.0}, {"drift": 0.003}])
def test_blur_other_walls_and_a_lamp_that_drifts_are_no_stale_frames(code: CodeName, change: dict[str, float]) -> None:
    refuse_stale(session_of(code, **change))


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
@pytest.mark.parametrize("first", [0.3, 0.8])
@pytest.mark.parametrize(("by", "word"), [(40.0, "brighter|darker"), (-40.0, "brighter|darker")])
def test_a_light_that_is_switched_among_the_stripes_is_named(
    code: CodeName, first: float, by: float, word: str
) -> None:
    frames = session_of(code, glow=0.8)
    late = list(frames)[round(first * len(frames)) :]
    changed = {name: frame + (by if name in late else 0) + 40 for name, frame in frames.items()}
    with pytest.raises(CalibrationError, match=f"all of the picture is ({word}) in them: light in the room"):
        refuse_stale(changed)


def under_mains_light(frames: dict[str, np.ndarray], swell: float, by: float) -> dict[str, np.ndarray]:
    """Light in the room at one phase of the mains, until a frame comes late: then a third of a period on."""
    late = 2 * len(frames) // 3
    return {
        name: frame + by * (1 + swell * np.cos(0.4 + (2 * np.pi / 3 if k >= late else 0.0)))
        for k, (name, frame) in enumerate(frames.items())
    }


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
def test_a_mains_light_that_swells_among_the_frames_is_no_light_that_was_switched(code: CodeName) -> None:
    """All frames are at one phase, until one comes late; what black showed of it says how far light may change."""
    frames = under_mains_light(session_of(code, glow=0.8), 0.4, 80.0)
    with pytest.raises(CalibrationError, match="light in the room was switched"):
        refuse_stale(frames)
    refuse_stale_frames(frames, 2 * 2**0.5, 500, swell=0.4)
    with pytest.raises(CalibrationError, match="light in the room was switched"):
        refuse_stale_frames(frames, 2 * 2**0.5, 500, swell=0.02)


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
def test_stale_frames_are_found_under_a_mains_light(code: CodeName) -> None:
    frames = under_mains_light(session_of(code, glow=0.8), 0.4, 80.0)
    names = list(frames)[2:]
    for before, name in list(pairwise(names))[::3]:
        with pytest.raises(CalibrationError, match=f"{name.removesuffix('-inverse')} .*stale frame"):
            refuse_stale_frames({**frames, name: frames[before]}, 2 * 2**0.5, 500, swell=0.4)


@pytest.mark.parametrize("code", ["gray", "long-run", "xor-02"])
@pytest.mark.parametrize("left", [40, 150])
def test_somebody_who_walks_through_the_picture_is_no_stale_frame(code: CodeName, left: int) -> None:
    frames = session_of(code, glow=0.8)
    for name in list(frames)[9:13]:
        frames[name] = frames[name].copy()
        frames[name][40:, left : left + 60] *= 0.3
    with pytest.raises(CalibrationError, match="somebody or something stood in the light"):
        refuse_stale(frames)


def test_pixels_that_see_no_light_at_all_do_not_disturb_the_others() -> None:
    """As where a camera's levels are cut off at black."""
    frames = {name: frame.copy() for name, frame in session_of("long-run", glow=0.8).items()}
    for frame in frames.values():
        frame[:40] = 0.0
    refuse_stale(frames)


def test_a_scene_without_light_has_no_stale_frames() -> None:
    frames = {name: np.full(SHAPE, 20.0) for name in session_of("gray")}
    refuse_stale(frames)


def test_edges_of_a_coarse_stripe_lie_where_only_the_next_finer_picture_is_lit() -> None:
    slots = Slots(("column",) * 3 + ("row",), (2, 1, 0, 0))
    assert slots.expected.tolist() == [[0, 1, -1, 0], [0, 0, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    assert slots.finest.tolist() == [False, False, True, True]


def places_of_edges(lit: np.ndarray) -> LinePlaces:
    """Places at edges of a coarse picture, where a finer one is lit or dark."""
    sides = [np.stack([np.full(len(lit), coarse), np.where(lit, 1.0, -1.0)]) for coarse in (-1.0, 0.01, 1.0)]
    left, middle, right = (side.astype(np.float32) for side in sides)
    middle[0] = 1  # of which side an edge itself is says nothing
    return LinePlaces(left, middle, right)


@pytest.mark.parametrize(
    ("edges", "lit", "contradicts"),
    [(120, 74, False), (120, 24, True), (6000, 3600, True), (6000, 5800, False)],
    ids=[
        "few, a third ends of surfaces",
        "few, of a wrong picture",
        "many, half of them wrong",
        "many, nearly all right",
    ],
)
def test_how_far_edges_may_disagree_depends_on_how_many_there_are(edges: int, lit: int, contradicts: bool) -> None:
    """Ends of surfaces pass for edges, and lie anywhere."""
    evidence = evidence_of(
        stripes_of(places_of_edges(np.arange(edges) < lit), [(0, None), (1, None)]), Slots(("row",) * 2, (1, 0))
    )
    assert evidence.consistent(as_named(evidence.slots)) is not contradicts


def test_one_long_end_of_a_surface_upon_an_edge_does_not_outvote_it() -> None:
    """There other pictures change with it, and all of its lines show the same, however many they are."""
    at_edge, along_end = 14, 35
    slots = Slots(("row",) * 4, (3, 2, 1, 0))
    step = np.repeat([[-1.0, 1.0]], [at_edge, along_end], axis=1)[0]
    left = np.array([-np.ones_like(step), np.ones_like(step), -np.ones_like(step), -np.ones_like(step)])
    right = np.array([np.ones_like(step), np.ones_like(step), step, step])
    middle = np.array([np.zeros_like(step), np.ones_like(step), step, step])
    middle[0] = 1
    places = LinePlaces(*(side.astype(np.float32) for side in (left, middle, right)))
    stripes = stripes_of(places, [(k, None) for k in range(len(slots.bit))])
    assert stripes.at_edges[0, 1:].tolist() == pytest.approx([1, -0.57, -0.57], abs=0.01)
    evidence = evidence_of(stripes, slots)
    assert evidence.consistent(as_named(evidence.slots))


def test_finest_stripes_without_inverses_that_nothing_is_left_of_are_told_and_do_not_refuse_the_others(
    frames: dict[str, np.ndarray],
) -> None:
    plain = {name: frame for name, frame in frames.items() if not name.endswith("-inverse")}
    grey = np.mean([frames["gray-column-00"], frames["gray-column-00-inverse"]], axis=0)
    noise = np.random.default_rng(5).normal(0, 1, grey.shape)
    order = check_gray_frames({**plain, "gray-column-00": (grey + noise).astype(np.uint8)}, 10)
    assert order.as_named
    assert order.unresolved == ("gray-column-00",)


def test_a_grey_photograph_of_coarser_stripes_is_refused(frames: dict[str, np.ndarray]) -> None:
    plain = {name: frame for name, frame in frames.items() if not name.endswith("-inverse")}
    grey = np.mean([frames["gray-column-02"], frames["gray-column-02-inverse"]], axis=0)
    with pytest.raises(CalibrationError, match="gray-column-02"):
        check_gray_frames({**plain, "gray-column-02": grey.astype(np.uint8)}, 10)
