"""What the projectors of a rig show: a picture on one of them, while all others are black."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.capture.recovery import talking_to
from rig.devices.protocols import Codes, Projector, check_on_screen

BLACK = "black"
"""What logs call the picture of a projector that is not asked for."""


class Projection:
    """The projectors of a rig, by name.

    A projector is made black once, when another one's turn comes, and again only after it has shown something or was
    opened again.
    """

    def __init__(self, projectors: Mapping[str, Projector]):
        self._projectors = projectors
        self._black_since_s: dict[str, float] = {}
        """When the black of those that show it was on screen."""

    def show(self, projector: str, codes: Codes, name: str, latencies_s: Mapping[str, float]) -> float:
        """Show codes on one projector, and return when all light has settled.

        Parameters
        ----------
        projector
            Name of the one that shows them.
        codes
            uint8, (H, W) or (H, W, 3).
        name
            The picture's.
        latencies_s
            From a projector's time stamp to settled light, by name.

        Returns
        -------
        Seconds on the rig's clock.
        """
        dark_s = [self._black_s(other) + latencies_s[other] for other in self._projectors if other != projector]
        self._black_since_s.pop(projector, None)
        return max([*dark_s, self._shown_s(projector, codes, name) + latencies_s[projector]])

    def _black_s(self, name: str) -> float:
        if name not in self._black_since_s:
            black = np.zeros(self._projectors[name].shape, dtype=np.uint8)
            self._black_since_s[name] = self._shown_s(name, black, BLACK)
        return self._black_since_s[name]

    def _shown_s(self, projector: str, codes: Codes, name: str) -> float:
        with talking_to(self._projectors[projector]):
            return self._projectors[projector].show(codes, name=name).on_screen_s

    def check(self) -> None:
        """Raise unless every picture is still on screen, where a projector can tell."""
        for projector in self._projectors.values():
            with talking_to(projector):
                check_on_screen(projector)

    def forget(self) -> None:
        """They were opened, or opened again: nobody knows what they show."""
        self._black_since_s.clear()
