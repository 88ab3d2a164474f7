"""What a surface's patches reflect besides their matte part: how much, and how rough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.arguments import array_of
from sim.arrays import BoolArray, FloatArray
from sim.errors import SimulationError
from sim.geometry.surface import Surface
from sim.light.gloss.lobe import LEAST_ROUGHNESS, mean_albedo

MOST_REFLECTED = 1.0
"""Matte reflectance and gloss of a patch together: more would create light."""
MOST_GLOSS = 0.99
"""Of a patch: beyond it light between two mirrors hardly fades."""


@dataclass(frozen=True, eq=False)
class Gloss:
    """The glossy lobe of each patch: ρ_s f_s beside the matte ρ / π.

    Raises
    ------
    SimulationError
        For arrays of different lengths, a gloss outside 0 ... 0.99, or a roughness outside 0.001 ... 1.
    """

    share: FloatArray
    """(P,) ρ_s: of light that arrives, what the lobe sends back at most; 0: a matte patch."""
    roughness: FloatArray
    """(P,) α of the GGX distribution."""

    def __post_init__(self) -> None:
        share, roughness = array_of("gloss", self.share), array_of("roughness", self.roughness)
        if share.ndim != 1 or share.shape != roughness.shape:
            raise SimulationError(f"gloss of shape {share.shape} and roughness of {roughness.shape}; one a patch each")
        if not ((share >= 0) & (share <= MOST_GLOSS)).all():
            raise SimulationError(f"gloss {share.min():.4g} ... {share.max():.4g}; it must lie in 0 ... {MOST_GLOSS}")
        if not ((roughness >= LEAST_ROUGHNESS) & (roughness <= 1)).all():
            raise SimulationError(
                f"roughness {roughness.min():.4g} ... {roughness.max():.4g}; it must lie in {LEAST_ROUGHNESS} ... 1: "
                "a mirror is no lobe"
            )
        object.__setattr__(self, "share", share)
        object.__setattr__(self, "roughness", roughness)

    @classmethod
    def of(cls, surface: Surface, share: ArrayLike, roughness: ArrayLike = 0.3) -> Gloss:
        """Return the gloss of a surface's patches, and hold it to what they reflect matte.

        Parameters
        ----------
        surface : Surface
        share, roughness : float or (P,) array

        Returns
        -------
        Gloss

        Raises
        ------
        SimulationError
            As the class does, and where matte and glossy reflection together are more than 1.
        """
        n = surface.n_patches
        values = [array_of(name, value) for name, value in (("gloss", share), ("roughness", roughness))]
        if any(value.shape not in ((), (n,)) for value in values):
            shapes = " and ".join(str(value.shape) for value in values)
            raise SimulationError(f"{surface.name}: gloss and roughness of shapes {shapes} for {n} patches; one each")
        gloss = cls(*(np.broadcast_to(value, (n,)).copy() for value in values))
        gloss.refuse_light_creating(surface)
        return gloss

    def refuse_light_creating(self, surface: Surface) -> None:
        """Raise SimulationError where this gloss is not of that surface, or both together reflect more than 1."""
        if len(self.share) != surface.n_patches:
            raise SimulationError(
                f"{surface.name}: gloss of {len(self.share)} patches for {surface.n_patches}; one a patch"
            )
        total = np.asarray(surface.reflectance) + self.share
        worst = int(total.argmax())
        if total[worst] > MOST_REFLECTED + 1e-12:
            raise SimulationError(
                f"{surface.name}: patch {worst} reflects {surface.reflectance[worst]:.4g} matte and "
                f"{self.share[worst]:.4g} glossy, together more than {MOST_REFLECTED:g}; lower one of them"
            )

    @property
    def glossy(self) -> BoolArray:
        """(P,) patches that have a lobe."""
        return np.asarray(self.share > 0)

    @property
    def mean_albedo(self) -> FloatArray:
        """(P,) share of even light from all directions that the lobe sends back: at most ``share``."""
        return self.share * mean_albedo(self.roughness)


def matte_equivalent(surface: Surface, gloss: Gloss) -> FloatArray:
    """Return (P,) the reflectance of matte patches that send back as much of even light: ρ + ρ_s ā(α)."""
    return np.asarray(np.minimum(np.asarray(surface.reflectance) + gloss.mean_albedo, 1.0))
