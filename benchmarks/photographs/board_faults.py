"""What people do to photographs of boards, or write of them, that is not so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from board_scenes import BoardSet, Frame, clean_set, photograph, photographed, stand
from set_runs import name_of

from calibration.geometry.pinhole import rotation_of


def _stripes(set_: BoardSet) -> list[str]:
    return [name for name in set_.shown if name.startswith("gray-")]


def _any(set_: BoardSet, random: np.random.Generator) -> dict[str, Frame]:
    """The photographs of a pose."""
    return set_.frames[int(random.integers(len(set_.frames)))]


def _swap(frames: dict[str, Frame], one: str, other: str) -> None:
    frames[one], frames[other] = frames[other], frames[one]


def _exchange(set_: BoardSet, random: np.random.Generator) -> None:
    _swap(_any(set_, random), *random.choice(_stripes(set_), 2, replace=False))


def _exchange_everywhere(set_: BoardSet, random: np.random.Generator) -> None:
    one, other = random.choice(_stripes(set_), 2, replace=False)
    for frames in set_.frames:
        _swap(frames, one, other)


def _exchange_of_poses(set_: BoardSet, random: np.random.Generator) -> None:
    """One photograph of a pose is another pose's."""
    one, other = random.choice(len(set_.frames), 2, replace=False)
    name = str(random.choice(_stripes(set_)))
    set_.frames[one][name], set_.frames[other][name] = set_.frames[other][name], set_.frames[one][name]


def _stripes_of_another_pose(set_: BoardSet, random: np.random.Generator) -> None:
    """All stripes of two poses are exchanged; their white and black are not."""
    one, other = random.choice(len(set_.frames), 2, replace=False)
    for name in _stripes(set_):
        set_.frames[one][name], set_.frames[other][name] = set_.frames[other][name], set_.frames[one][name]


def _white_of_another_pose(set_: BoardSet, random: np.random.Generator) -> None:
    one, other = random.choice(len(set_.frames), 2, replace=False)
    for name in ("white", "black"):
        set_.frames[one][name], set_.frames[other][name] = set_.frames[other][name], set_.frames[one][name]


def _stale(set_: BoardSet, random: np.random.Generator) -> None:
    frames, names = _any(set_, random), _stripes(set_)
    k = int(random.integers(1, len(names)))
    frames[names[k]] = frames[names[k - 1]].copy()


def _inversion(set_: BoardSet, random: np.random.Generator) -> None:
    name = str(random.choice([name for name in _stripes(set_) if not name.endswith("-inverse")]))
    _swap(_any(set_, random), name, f"{name}-inverse")


def _inversion_everywhere(set_: BoardSet, random: np.random.Generator) -> None:
    name = str(random.choice([name for name in _stripes(set_) if not name.endswith("-inverse")]))
    for frames in set_.frames:
        _swap(frames, name, f"{name}-inverse")


def _inverses_everywhere(set_: BoardSet, _: np.random.Generator) -> None:
    for name in _stripes(set_):
        if not name.endswith("-inverse"):
            for frames in set_.frames:
                _swap(frames, name, f"{name}-inverse")


def _axes_exchanged(set_: BoardSet, _: np.random.Generator) -> None:
    turn = {"column": "row", "row": "column"}
    for view, frames in enumerate(set_.frames):
        renamed = {"-".join(turn.get(part, part) for part in name.split("-")): frame for name, frame in frames.items()}
        set_.frames[view] = {name: renamed.get(name, frames["black"]) for name in frames}


def _order_reversed(set_: BoardSet, _: np.random.Generator) -> None:
    for frames in set_.frames:
        for axis in ("column", "row"):
            for ending in ("", "-inverse"):
                names = sorted(
                    n for n in _stripes(set_) if n.split("-")[1] == axis and n.endswith("-inverse") == bool(ending)
                )
                frames |= dict(zip(names, [frames[name] for name in reversed(names)], strict=True))


def _bump(set_: BoardSet, random: np.random.Generator) -> None:
    frames, names = _any(set_, random), list(set_.shown)
    for name in names[int(random.integers(1, len(names) - 2)) :]:
        frames[name] = np.roll(frames[name], int(random.integers(3, 20)), axis=int(random.integers(2)))


def _board_touched(set_: BoardSet, random: np.random.Generator) -> None:
    """The board is turned by half a degree to three between columns and rows of one pose."""
    view = int(random.integers(len(set_.frames)))
    turns = set_.state.rotations.copy()
    turns[view] = rotation_of(np.deg2rad(random.uniform(0.5, 3)) * np.eye(3)[int(random.integers(3))]) @ turns[view]
    place = stand(replace(set_.state, rotations=turns), view, set_.told_board, set_.look)
    for name in set_.shown:
        if not name.startswith("gray-column"):
            set_.frames[view][name] = photograph(place, set_.shown[name], set_.look, random)


def _half(set_: BoardSet, random: np.random.Generator) -> None:
    frames, name = _any(set_, random), str(random.choice(_stripes(set_)))
    frames[name] = (frames[name] // 2).astype(np.uint8)


def _black_one(set_: BoardSet, random: np.random.Generator) -> None:
    frames, name = _any(set_, random), str(random.choice(_stripes(set_)))
    frames[name] = np.zeros_like(frames[name])


def _over_exposed(set_: BoardSet, _: np.random.Generator) -> None:
    for frames in set_.frames:
        for name, frame in frames.items():
            frames[name] = np.minimum(frame.astype(np.int64) * 3, 255).astype(np.uint8)


def _board_size_wrong(set_: BoardSet, random: np.random.Generator) -> None:
    board = set_.told_board
    if random.random() < 0.5:
        set_.told_board = replace(board, columns=board.columns - 1)
    else:
        set_.told_board = replace(board, columns=board.rows, rows=board.columns)


def _unit_wrong(set_: BoardSet, _: np.random.Generator) -> None:
    board = set_.told_board
    set_.told_board = replace(board, square_m=1000 * board.square_m, marker_m=1000 * board.marker_m)


def _zoomed(set_: BoardSet, random: np.random.Generator) -> None:
    """The camera's zoom was touched before some of the poses."""
    _magnified(set_, int(random.integers(1, len(set_.frames))), float(random.choice([1.01, 1.03, 1.1])))


def _refocused(set_: BoardSet, random: np.random.Generator) -> None:
    """Autofocus breathes: each pose has its own focal length."""
    for view in range(len(set_.frames)):
        _magnified(set_, view, float(random.uniform(0.99, 1.01)), most=view + 1)


def _magnified(set_: BoardSet, first: int, times: float, most: int | None = None) -> None:
    for frames in set_.frames[first:most]:
        for name, frame in frames.items():
            height, width = frame.shape
            middle = np.array([width - 1, height - 1]) / 2
            matrix = np.column_stack([times * np.eye(2), (1 - times) * middle])
            frames[name] = np.asarray(
                cv2.warpAffine(frame, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            ).astype(np.uint8)


def _shifted(set_: BoardSet, random: np.random.Generator) -> None:
    """Some poses were cut out of the sensor elsewhere, and nobody said so."""
    right, down = random.integers(-14, 15, 2).tolist()
    for frames in set_.frames[int(random.integers(1, len(set_.frames))) :]:
        for name, frame in frames.items():
            frames[name] = np.roll(frame, (down, right), axis=(0, 1))


def _pair_moved(set_: BoardSet, random: np.random.Generator) -> None:
    """Camera or projector was moved between the poses."""
    first = int(random.integers(1, len(set_.frames)))
    turn = rotation_of(np.deg2rad(random.uniform(0.3, 3)) * np.eye(3)[int(random.integers(3))])
    moved = replace(
        set_.state,
        projector_rotation=turn @ set_.state.projector_rotation,
        projector_translation_m=turn @ set_.state.projector_translation_m,
    )
    for view in range(first, len(set_.frames)):
        set_.stands[view] = stand(moved, view, set_.told_board, set_.look)
        set_.frames[view] = photographed(set_, view, random)


def _mirrored(set_: BoardSet, _: np.random.Generator) -> None:
    for frames in set_.frames:
        for name, frame in frames.items():
            frames[name] = np.ascontiguousarray(frame[:, ::-1])


def _one_mirrored(set_: BoardSet, random: np.random.Generator) -> None:
    frames = _any(set_, random)
    for name, frame in frames.items():
        frames[name] = np.ascontiguousarray(frame[:, ::-1])


def _one_upside_down(set_: BoardSet, random: np.random.Generator) -> None:
    """A telephone that turned its picture."""
    frames = _any(set_, random)
    for name, frame in frames.items():
        frames[name] = np.ascontiguousarray(frame[::-1, ::-1])


def _same_pose_twice(set_: BoardSet, random: np.random.Generator) -> None:
    one, other = random.choice(len(set_.frames), 2, replace=False)
    set_.frames[one] = {name: frame.copy() for name, frame in set_.frames[other].items()}


def _wrong_projector_size(set_: BoardSet, random: np.random.Generator) -> None:
    width, height = set_.told_projector_size
    set_.told_projector_size = int(width * random.uniform(0.6, 1.5)) // set_.told_step_px * set_.told_step_px, height


def _wrong_step(set_: BoardSet, _: np.random.Generator) -> None:
    set_.told_step_px *= 2


def _full_scale_wrong(set_: BoardSet, _: np.random.Generator) -> None:
    set_.told_full_scale_dn = 65535


def _frontal(set_: BoardSet, random: np.random.Generator) -> None:
    """All boards face the camera: no tilt tells the focal length."""
    turns = np.stack([rotation_of([0, 0, random.uniform(-0.3, 0.3)]) for _ in set_.frames])
    middle = np.array([*(set_.told_board.points_m.mean(axis=0)), 0.0])
    places = set_.state.translations_m + (set_.state.rotations - turns) @ middle
    set_.state = replace(set_.state, rotations=turns, translations_m=places)
    for view in range(len(set_.frames)):
        set_.stands[view] = stand(set_.state, view, set_.told_board, set_.look)
        set_.frames[view] = photographed(set_, view, random)


FAULTS: tuple[Callable[[BoardSet, np.random.Generator], None], ...] = (
    _exchange,
    _exchange_everywhere,
    _exchange_of_poses,
    _stripes_of_another_pose,
    _white_of_another_pose,
    _stale,
    _inversion,
    _inversion_everywhere,
    _inverses_everywhere,
    _axes_exchanged,
    _order_reversed,
    _bump,
    _board_touched,
    _half,
    _black_one,
    _over_exposed,
    _board_size_wrong,
    _unit_wrong,
    _zoomed,
    _refocused,
    _shifted,
    _pair_moved,
    _mirrored,
    _one_mirrored,
    _one_upside_down,
    _same_pose_twice,
    _wrong_projector_size,
    _wrong_step,
    _full_scale_wrong,
    _frontal,
)


def drawn(seed: int) -> BoardSet:
    """A set by its number; one of three has no fault."""
    random = np.random.default_rng([seed, 5])
    set_ = clean_set(random)
    if random.random() < 1 / 3:
        return set_
    fault = FAULTS[int(random.integers(len(FAULTS)))]
    fault(set_, random)
    set_.fault = name_of(fault)
    return set_
