"""A structured-light code: Gray code, its columns counted from the right."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration import CODES, Correspondence, Pattern

GRAY = CODES["gray"]


class Mirrored:
    name = "mirrored"
    version = "1"

    def pattern_names(self, projector_shape: tuple[int, int]) -> tuple[str, ...]:
        return tuple(f"mirrored-{name}" for name in GRAY.pattern_names(projector_shape))

    def patterns(self, projector_shape: tuple[int, int]) -> Iterator[Pattern]:
        for pattern in GRAY.patterns(projector_shape):
            yield Pattern(f"mirrored-{pattern.name}", np.ascontiguousarray(pattern.codes[:, ::-1]))

    def decode(
        self,
        frames: Mapping[str, NDArray[np.floating]],
        projector_shape: tuple[int, int],
        *,
        white: NDArray[np.floating],
        black: NDArray[np.floating],
        noise_limit: float | NDArray[np.floating],
        saturation: float | None = None,
    ) -> Correspondence:
        plain = {name.removeprefix("mirrored-"): frame for name, frame in frames.items()}
        found = GRAY.decode(
            plain, projector_shape, white=white, black=black, noise_limit=noise_limit, saturation=saturation
        )
        xy = found.projector_xy_px.copy()
        xy[..., 0] = projector_shape[1] - 1 - xy[..., 0]
        return replace(found, projector_xy_px=xy)


CODE = Mirrored()
