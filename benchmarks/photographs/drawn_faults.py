"""What people do to a set of photographs, or write of it, that is not so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from drawn_scenes import DrawnSet, photographed
from set_runs import name_of


def coded_of(set_: DrawnSet) -> list[str]:
    """Photographs of stripes."""
    return [name for name in set_.frames if name.startswith("gray-")]


def _exchange(set_: DrawnSet, random: np.random.Generator) -> None:
    one, other = random.choice(coded_of(set_), 2, replace=False)
    set_.frames[one], set_.frames[other] = set_.frames[other], set_.frames[one]


def _stale(set_: DrawnSet, random: np.random.Generator) -> None:
    names = coded_of(set_)
    k = int(random.integers(1, len(names)))
    set_.frames[names[k]] = set_.frames[names[k - 1]].copy()


def _inversion(set_: DrawnSet, random: np.random.Generator) -> None:
    pairs = [name for name in coded_of(set_) if f"{name}-inverse" in set_.frames]
    if pairs:
        one = str(random.choice(pairs))
        set_.frames[one], set_.frames[f"{one}-inverse"] = set_.frames[f"{one}-inverse"], set_.frames[one]


def _bump(set_: DrawnSet, random: np.random.Generator) -> None:
    names = list(set_.frames)
    for name in names[int(random.integers(1, len(names))) :]:
        set_.frames[name] = np.roll(set_.frames[name], 20, axis=int(random.integers(0, 1)))


def _half(set_: DrawnSet, random: np.random.Generator) -> None:
    name = str(random.choice(coded_of(set_)))
    set_.frames[name] = (set_.frames[name] // 2).astype(set_.frames[name].dtype)


def _axes_exchanged(set_: DrawnSet, _: np.random.Generator) -> None:
    turn = {"column": "row", "row": "column"}
    set_.frames = {
        "-".join(turn.get(part, part) for part in name.split("-")): frame for name, frame in set_.frames.items()
    }


def _order_reversed(set_: DrawnSet, _: np.random.Generator) -> None:
    """Finest stripes first."""
    for axis in ("column", "row"):
        for ending in ("", "-inverse"):
            names = sorted(
                n for n in coded_of(set_) if n.split("-")[1] == axis and n.endswith("-inverse") == bool(ending)
            )
            frames = [set_.frames[name] for name in names]
            set_.frames |= dict(zip(names, reversed(frames), strict=True))


def _pose_reversed(set_: DrawnSet, _: np.random.Generator) -> None:
    camera, projector = set_.told
    set_.told = (
        camera,
        replace(
            projector, rotation=projector.rotation.T, translation_m=-projector.rotation.T @ projector.translation_m
        ),
    )


def _rotation_transposed(set_: DrawnSet, _: np.random.Generator) -> None:
    camera, projector = set_.told
    set_.told = camera, replace(projector, rotation=projector.rotation.T)


def _baseline_reversed(set_: DrawnSet, _: np.random.Generator) -> None:
    camera, projector = set_.told
    set_.told = camera, replace(projector, translation_m=-projector.translation_m)


def _lenses_exchanged(set_: DrawnSet, _: np.random.Generator) -> None:
    camera, projector = set_.told
    set_.told = (
        replace(camera, focal_px=projector.focal_px, principal_point_px=projector.principal_point_px),
        replace(projector, focal_px=camera.focal_px, principal_point_px=camera.principal_point_px),
    )


def _focal_off(set_: DrawnSet, random: np.random.Generator) -> None:
    devices = list(set_.told)
    k = int(random.integers(2))
    devices[k] = replace(devices[k], focal_px=tuple(1.15 * f for f in devices[k].focal_px))
    set_.told = devices[0], devices[1]


def _principal_point_off(set_: DrawnSet, random: np.random.Generator) -> None:
    devices = list(set_.told)
    k = int(random.integers(2))
    x, y = devices[k].principal_point_px
    devices[k] = replace(devices[k], principal_point_px=(y, x))
    set_.told = devices[0], devices[1]


def _projector_turned(set_: DrawnSet, _: np.random.Generator) -> None:
    """A projector that hangs from the ceiling, and was said to stand."""
    camera, projector = set_.told
    set_.told = camera, replace(projector, rotation=np.diag([-1.0, -1.0, 1.0]) @ projector.rotation)


def _first_code_off(set_: DrawnSet, random: np.random.Generator) -> None:
    set_.first_code = (int(random.integers(5, 30)), 0) if random.random() < 0.5 else (0, int(random.integers(5, 30)))


def _camera_halved(set_: DrawnSet, _: np.random.Generator) -> None:
    """Photographs at half the size, lens numbers of the whole."""
    set_.frames = {
        name: cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        for name, frame in set_.frames.items()
    }


def _mirrored(set_: DrawnSet, _: np.random.Generator) -> None:
    set_.frames = {name: np.ascontiguousarray(frame[:, ::-1]) for name, frame in set_.frames.items()}


def _full_scale_wrong(set_: DrawnSet, _: np.random.Generator) -> None:
    set_.full_scale_dn = 65535 if set_.full_scale_dn < 65535 else 4095


def _unit_wrong(set_: DrawnSet, _: np.random.Generator) -> None:
    """Lengths in millimetres, called metres."""
    camera, projector = set_.told
    set_.told = camera, replace(projector, translation_m=1000 * projector.translation_m)


def _black_one(set_: DrawnSet, random: np.random.Generator) -> None:
    name = str(random.choice(coded_of(set_)))
    set_.frames[name] = np.zeros_like(set_.frames[name])


def _over_exposed(set_: DrawnSet, _: np.random.Generator) -> None:
    set_.frames = {
        name: np.minimum(frame.astype(np.int64) * 3, set_.full_scale_dn).astype(frame.dtype)
        for name, frame in set_.frames.items()
    }


def _wrong_projector_size(set_: DrawnSet, random: np.random.Generator) -> None:
    camera, projector = set_.told
    width = int(projector.width_px * random.uniform(0.55, 0.95))
    if (width - 1).bit_length() == (projector.width_px - 1).bit_length():
        set_.told = camera, replace(projector, width_px=width)


def _one_missing(set_: DrawnSet, random: np.random.Generator) -> None:
    """The coarsest photograph of an axis was not listed."""
    axis = str(random.choice([name.split("-")[1] for name in coded_of(set_)]))
    coarsest = max(name.split("-")[2] for name in coded_of(set_) if name.split("-")[1] == axis)
    set_.frames = {name: f for name, f in set_.frames.items() if not name.startswith(f"gray-{axis}-{coarsest}")}


FAULTS: tuple[Callable[[DrawnSet, np.random.Generator], None], ...] = (
    _exchange,
    _stale,
    _inversion,
    _bump,
    _half,
    _axes_exchanged,
    _order_reversed,
    _pose_reversed,
    _rotation_transposed,
    _baseline_reversed,
    _lenses_exchanged,
    _focal_off,
    _principal_point_off,
    _projector_turned,
    _first_code_off,
    _camera_halved,
    _mirrored,
    _full_scale_wrong,
    _unit_wrong,
    _black_one,
    _over_exposed,
    _wrong_projector_size,
    _one_missing,
)


NUMBERS = {
    "pose-reversed",
    "rotation-transposed",
    "baseline-reversed",
    "lenses-exchanged",
    "focal-off",
    "principal-point-off",
    "projector-turned",
    "first-code-off",
    "camera-halved",
    "mirrored",
}
"""Faults of numbers: columns or rows alone may have points with these, too, and no photograph that contradicts them."""


def drawn(seed: int) -> DrawnSet:
    """Photographs, half of them with one fault."""
    random = np.random.default_rng([seed, 5077])
    set_ = photographed(random)
    if random.random() < 0.5:
        fault = FAULTS[int(random.integers(len(FAULTS)))]
        set_.fault = name_of(fault)
        fault(set_, random)
    return set_
