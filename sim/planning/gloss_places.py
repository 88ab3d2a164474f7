"""Points on glossy patches: where the lamp's light goes from them, and what is seen in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.light.gloss.exchange import cosine_directions, points_on
from sim.light.gloss.lobe import albedo, frames_of, lobe, lobe_directions
from sim.light.gloss.walks import Arrivals, GlossySurface, LightLeg, even_points
from sim.light.lighting import Lighting


@dataclass(frozen=True, eq=False, kw_only=True)
class Places:
    """Points, ``count`` on each of G glossy patches."""

    glossy: GlossySurface
    count: int
    patch: IntArray
    """(G count,) of each point."""
    points_m: FloatArray
    """(G count, 3)"""
    chances: FloatArray
    """(G count, 6) even, for directions."""
    random: np.random.Generator
    """For all directions after them."""

    def lamp_by_gloss(self, light: Lighting) -> FloatArray:
        """Return (P,) irradiance by light that goes from the lamp to glossy patches and on from their lobes."""
        areas = self.glossy.surface.areas
        power = self._straight(light) * areas[self.patch] / self.count
        received = np.zeros(len(areas))
        for leg in self._further(self._arriving(light), self.chances[:, 2:4]):
            received += np.bincount(leg.patch, power[leg.walk] * leg.share, minlength=len(areas))
        return np.asarray(received / areas)

    def seen_error(
        self, glossy_matte: FloatArray, matte: FloatArray, send_back: FloatArray, light: Lighting
    ) -> FloatArray:
        """Return (G,) the squared error of what is seen of glossy patches, if they are taken for matte ones.

        Two rays of each lobe are independent, so that the product of what they show has no bias by noise.

        Parameters
        ----------
        glossy_matte, matte : (P,) array
            What patches send back matte of light from others: with gloss, and if all are matte.
        send_back : (P,) array
            What they send back of light straight from the lamp: matte, and of even light glossy.
        light : Lighting

        Returns
        -------
        (G,) array
            Mean over points and directions; noise may bring it below 0.
        """
        towards = -cosine_directions(self.glossy.surface, self.patch, self.chances[:, :2])
        known = (glossy_matte - matte)[self.patch]
        one, other = (
            known
            + self._seen(towards, self.chances[:, k : k + 2], others=glossy_matte, send_back=send_back, light=light)
            for k in (2, 4)
        )
        return self._each_patch(one * other)

    def highlight_error(self, light: Lighting) -> FloatArray:
        """Return (G,) the squared error of the lamp's light that is reflected once, over all directions.

        With A = π ρ_s f_s H and b = ρ_s ā H its mean is <A²> - 2 <A> b + b²: <A> = ρ_s a(cos θ) H, and
        <A²> = π (ρ_s H)² ∫ f_s² cos θ' dω' from directions of the lobe.
        """
        gloss, H = self.glossy.gloss, self._straight(light)
        share, roughness = gloss.share[self.patch], gloss.roughness[self.patch]
        axes = frames_of(self.glossy.surface.normals[self.patch])
        coming = -np.einsum("nij,nj->ni", axes, self._arriving(light))
        coming[:, 2] = np.maximum(coming[:, 2], 1e-9)
        kept = albedo(coming[:, 2], roughness)
        b = gloss.mean_albedo[self.patch] * H
        if light.source_m is None:
            return self._each_patch((share * kept * H - b) ** 2)
        going, weight = lobe_directions(coming, roughness, self.chances[:, 2:4])
        squared = np.pi * (share * H) ** 2 * weight * lobe(coming, going, roughness)
        return self._each_patch(squared - 2 * share * kept * H * b + b**2)

    def _seen(
        self,
        towards: FloatArray,
        chances: FloatArray,
        *,
        others: FloatArray,
        send_back: FloatArray,
        light: Lighting,
    ) -> FloatArray:
        """(N,) π times the radiance in the lobe of each point, seen along ``towards``."""
        seen = np.zeros(len(self.patch))
        cells = self.glossy.surface
        for leg in self._further(towards, chances):
            straight = light.irradiance(leg.points_m, cells.normals[leg.patch], cells.region[leg.patch])
            value = others[leg.patch] + send_back[leg.patch] * straight
            seen += np.bincount(leg.walk, leg.share * value, minlength=len(seen))
        return seen

    def _further(self, directions: FloatArray, chances: FloatArray) -> list[LightLeg]:
        begin = Arrivals(
            walk=np.arange(len(self.patch)),
            patch=self.patch,
            points_m=self.points_m,
            directions=directions,
            share=np.ones(len(self.patch)),
        )
        return list(self.glossy.further(begin, chances, self.random)) if len(self.patch) else []

    def _straight(self, light: Lighting) -> FloatArray:
        """(N,) irradiance straight from the lamp."""
        cells = self.glossy.surface
        return light.irradiance(self.points_m, cells.normals[self.patch], cells.region[self.patch])

    def _arriving(self, light: Lighting) -> FloatArray:
        """(N, 3) ways of the lamp's light: from its source, else from everywhere alike."""
        if light.source_m is None:
            return -cosine_directions(self.glossy.surface, self.patch, self.chances[:, :2])
        ways = self.points_m - light.source_m
        return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))

    def _each_patch(self, values: FloatArray) -> FloatArray:
        return np.asarray(values.reshape(-1, self.count).mean(axis=1))


def places_on(glossy: GlossySurface, count: int, seed: int | tuple[int, int]) -> Places:
    """Spread ``count`` points evenly over each glossy patch, with even chances for what comes after."""
    patches = np.flatnonzero(glossy.gloss.glossy)
    random = np.random.default_rng((*np.atleast_1d(seed).tolist(), 4))
    chances = ((even_points(count, 8) + random.uniform(size=(len(patches), 1, 8))) % 1.0).reshape(-1, 8)
    patch = np.repeat(patches, count)
    return Places(
        glossy=glossy,
        count=count,
        patch=patch,
        points_m=points_on(glossy.surface, patch, chances[:, :2]),
        chances=chances[:, 2:],
        random=random,
    )
