"""What happens to boards, and to photographs that people take of them with care, but in a real room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from board_scenes import BoardSet, FloatArray, Frame, Look, Made, clean_set, photographed, stand
from drawn_roughness import ROUGHNESS, Taken
from numpy.typing import NDArray
from set_runs import name_of


@dataclass(eq=False)
class Pose:
    """The photographs of one pose."""

    frames: dict[str, NDArray[Any]]
    full_scale_dn: int = 255


def _made(set_: BoardSet, random: np.random.Generator, made: Made) -> None:
    """Photograph all poses again of a board that is made so."""
    for view in range(len(set_.frames)):
        set_.stands[view] = stand(set_.state, view, set_.told_board, set_.look, made)
        set_.frames[view] = photographed(set_, view, random)


def _extent_m(set_: BoardSet) -> FloatArray:
    return np.asarray(np.ptp(set_.told_board.points_m, axis=0))


def _bowed(set_: BoardSet, random: np.random.Generator) -> None:
    """A sheet of plastic that bends along any direction, by up to 2 % of its length, which it keeps."""
    way, size = random.uniform(0, np.pi), random.choice([-1, 1]) * random.uniform(0.002, 0.02)
    along, span, middle = np.array([np.cos(way), np.sin(way)]), float(_extent_m(set_).max()), _extent_m(set_) / 2

    def height_m(xy: FloatArray) -> FloatArray:
        return np.asarray(size * span * ((xy - middle) @ along / span * 2) ** 2)

    def print_at(xy: FloatArray) -> FloatArray:
        across = (xy - middle) @ along
        slope = 8 * size * across / span
        arc = (slope * np.hypot(1, slope) + np.arcsinh(slope)) * span / (16 * size)
        return np.asarray(xy + (arc - across)[:, None] * along)

    _made(set_, random, Made(height_m, print_at))


def _twisted(set_: BoardSet, random: np.random.Generator) -> None:
    size, (wide, high) = random.choice([-1, 1]) * random.uniform(0.002, 0.02), _extent_m(set_)
    _made(set_, random, Made(lambda xy: size * wide * (xy[:, 0] / wide - 0.5) * (xy[:, 1] / high - 0.5) * 4))


def _wrinkled(set_: BoardSet, random: np.random.Generator) -> None:
    """Paper that was glued on, with waves of a third of its width."""
    size, span = random.uniform(0.0005, 0.004), float(_extent_m(set_).max())
    phase, along = random.uniform(0, 2 * np.pi, 2), random.uniform(2, 5, 2) * np.pi / span

    def waves(xy: FloatArray) -> FloatArray:
        return np.asarray(size * span * np.sin(xy @ along + phase[0]) * np.cos(xy[:, 0] * along[1] + phase[1]))

    _made(set_, random, Made(waves))


def _corner_lifted(set_: BoardSet, random: np.random.Generator) -> None:
    """Paper that came off its board at one corner."""
    size, extent = random.uniform(0.01, 0.05), _extent_m(set_)
    _made(
        set_, random, Made(lambda xy: -size * extent.max() * np.maximum((xy / extent).sum(axis=1) - 1.4, 0) ** 2 / 0.36)
    )


def _printed_unevenly(set_: BoardSet, random: np.random.Generator) -> None:
    """A printer whose paper feed is off."""
    _made(set_, random, Made(stretch=(1.0, 1 + random.choice([-1, 1]) * random.uniform(0.001, 0.01))))


def _wall_behind(set_: BoardSet, random: np.random.Generator) -> None:
    _made(set_, random, Made(behind_m=float(_extent_m(set_).max() * random.uniform(0.3, 3))))


def _looks(set_: BoardSet, random: np.random.Generator, change: Callable[[Look], Look]) -> None:
    """Photograph each pose with a look of its own."""
    usual = set_.look
    for view in range(len(set_.frames)):
        set_.look = change(usual)
        set_.frames[view] = photographed(set_, view, random)
    set_.look = usual


def _out_of_focus(set_: BoardSet, random: np.random.Generator) -> None:
    """Boards nearer and farther than what the lens is focused on."""
    _looks(set_, random, lambda look: replace(look, blur_px=float(random.uniform(0.5, 4))))


def _exposed_anew(set_: BoardSet, random: np.random.Generator) -> None:
    """The exposure is set for each pose."""

    def again(look: Look) -> Look:
        times = float(random.uniform(0.25, 1.3))
        return replace(look, light_dn=times * look.light_dn, room_dn=times * look.room_dn)

    _looks(set_, random, again)


def _dim(set_: BoardSet, random: np.random.Generator) -> None:
    """A projector that is faint beside the room's light."""
    _looks(set_, random, lambda look: replace(look, light_dn=float(random.uniform(10, 50)), room_dn=80.0))


def _fingers(set_: BoardSet, random: np.random.Generator) -> None:
    """Hands hold the board, and hide some of it."""
    for view, place in enumerate(set_.stands):
        light, pixel = place.light.copy(), place.pixel.copy()
        height, width = light.shape
        row, column = np.mgrid[:height, :width]
        for _ in range(int(random.integers(1, 4))):
            x, y, r = random.uniform(0.2, 0.8) * width, random.uniform(0.2, 0.8) * height, random.uniform(10, 60)
            hidden = (column - x) ** 2 + ((row - y) / random.uniform(1, 3)) ** 2 < r**2
            light[hidden] = 0.45
            pixel[hidden] += random.uniform(2, 8)
        set_.stands[view] = replace(place, light=light, pixel=pixel)
        set_.frames[view] = photographed(set_, view, random)


def _of_all(set_: BoardSet, change: Callable[[Frame], FloatArray]) -> None:
    for frames in set_.frames:
        for name, frame in frames.items():
            frames[name] = np.clip(np.rint(change(frame)), 0, 255).astype(np.uint8)


def _tone_curve(set_: BoardSet, random: np.random.Generator) -> None:
    """Nearly every webcam."""
    power = 1 / random.uniform(1.4, 2.4)
    _of_all(set_, lambda frame: 255 * (frame / 255.0) ** power)


def _vignetted(set_: BoardSet, random: np.random.Generator) -> None:
    width, height = set_.look.camera_size
    row, column = np.mgrid[:height, :width]
    loss = random.uniform(0.3, 0.8)
    out = ((column / width - 0.5) ** 2 + (row / height - 0.5) ** 2) / 0.5
    _of_all(set_, lambda frame: frame * (1 - loss * out))


def _of_each_pose(change: Callable[[Taken, np.random.Generator], None]) -> Callable[..., None]:
    """What happens to photographs of a code, to those of each pose."""

    def changed(set_: BoardSet, random: np.random.Generator) -> None:
        for k, frames in enumerate(set_.frames):
            pose = Pose(frames)
            change(pose, random)
            set_.frames[k] = pose.frames

    changed.__name__ = change.__name__
    return changed


BOARD_ROUGHNESS: tuple[Callable[[BoardSet, np.random.Generator], None], ...] = (
    _bowed,
    _twisted,
    _wrinkled,
    _corner_lifted,
    _printed_unevenly,
    _wall_behind,
    _out_of_focus,
    _exposed_anew,
    _dim,
    _fingers,
    _tone_curve,
    _vignetted,
    *(_of_each_pose(change) for change in ROUGHNESS),
)


def rough_boards(seed: int) -> BoardSet:
    """Photographs of boards that are what they are called, with one of these."""
    random = np.random.default_rng([seed, 6113])
    set_ = clean_set(random)
    change = BOARD_ROUGHNESS[seed % len(BOARD_ROUGHNESS)]
    set_.fault = name_of(change)
    change(set_, random)
    return set_
