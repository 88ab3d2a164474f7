"""Adaptive patches: the fewest whose constant light is within a tolerance, from a coarser solution.

What is approximated is the light between the surfaces: the irradiance H = F B of a patch is one number, while
the true one varies. Over a patch its squared error is the integral of (g . (x - centre))², g the gradient of H
that neighbouring patches of the same flat region show; where the solution has several patches inside, their
variance is added. A patch is halved across its steepest direction, the worst ones first, until the sum meets
the goal.

A light's edge inside a patch moves the place from which light leaves. That matters to surfaces nearby only:
its squared error is SOURCE_WEIGHT area variance(E) min(1, (size / distance)⁴), the distance to the nearest
plane that the patch looks at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.form_factors.occlusion import segments_blocked
from sim.geometry.adaptive_patches import AdaptivePatches, joined
from sim.light.lighting import Lighting, emission

SOURCE_WEIGHT = 0.05
"""Squared error of the irradiance at a half-lit contact patch, over the light's variance; chosen, not measured."""
NEIGHBOURS = 8
"""Patches that a gradient is fitted to: as many as surround one in a grid."""
ROUGHNESS = 1.0
"""Weight of what a linear fit to the neighbours leaves, as a gradient in every direction; chosen, not measured."""
MOST_FACETS = 3
"""Patches of a region up to which it is taken for a facet of a curved surface."""
SMOOTH = 0.7
"""Cosine between the normals of facets of one curved surface: up to 45 degrees, as of a sphere of 80 facets."""
LONGEST_ASPECT = 2.9
"""More stretched patches are halved across: the halves are at most 1.45 times as long as wide."""
ABOVE = 1e-6
"""Of the scene's size: from so high above patches it is told what stands between them."""
MOST_PLANES = 64
"""Distances are measured to at most this many planes of regions."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SolvedPatches:
    """A coarse solution, and how its irradiance varies: what finer patches are planned from."""

    cells: AdaptivePatches
    irradiance: FloatArray
    """(P,) H = F B from the other patches; 1 = white."""
    gradient: FloatArray
    """(P, 3) of the irradiance in each patch's plane [1/m]."""
    roughness: FloatArray
    """(P,) square of a gradient in every direction, for what is not linear about a patch [1/m²]."""
    within: FloatArray
    """(P,) integral of its squared variation within each patch [m²]."""

    @classmethod
    def of(cls, cells: AdaptivePatches, irradiance: FloatArray) -> SolvedPatches:
        """Return a solution, (P,) irradiance, with gradients from neighbours in the same region."""
        gradient, roughness = gradients(cells, irradiance)
        within = cells.variation(gradient) + roughness * cells.polar_moments
        return cls(cells=cells, irradiance=irradiance, gradient=gradient, roughness=roughness, within=within)

    @property
    def error(self) -> float:
        """RMS over the surface of what the radiosity varies about its patches' values."""
        squared = self.cells.reflectance**2 * self.within
        return float(np.sqrt(squared.sum() / self.cells.areas.sum()))


def gradients(cells: AdaptivePatches, values: FloatArray, *, in_sight: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return (P, 3) gradients in each patch's plane, and (P,) roughness.

    Least squares over the nearest patches of the same region, or, where a region is a facet or two, over the nearest
    patches that are turned little against it; what they leave, over the area, is the roughness. With ``in_sight``
    patches of a region that something stands between tell nothing of each other.
    """
    gradient, left = np.zeros((cells.n_patches, 3)), np.zeros(cells.n_patches)
    facets = np.bincount(cells.region)[cells.region] <= MOST_FACETS
    flat = np.flatnonzero(~facets)
    if len(flat):
        near = _nearest_of_region(cells, flat[np.argsort(cells.region[flat], kind="stable")])[flat]
        if in_sight:
            near = np.where(_hidden(cells, flat, near), flat[:, None], near)
        gradient[flat], left[flat] = _fitted(cells, flat, near, values)
    if facets.sum() > MOST_FACETS:
        curved = np.flatnonzero(facets)
        near = curved[_nearest(cells.centres[curved], cells.centres[curved])]
        gradient[curved], left[curved] = _fitted(cells, curved, near, values)
    return gradient, ROUGHNESS * left / cells.areas


def _nearest_of_region(cells: AdaptivePatches, order: IntArray) -> IntArray:
    """(P, 9) nearest of the same region, of patches in the order of their regions; itself where there are fewer."""
    near = np.tile(np.arange(cells.n_patches)[:, None], NEIGHBOURS + 1)
    for here in np.split(order, np.flatnonzero(np.diff(cells.region[order])) + 1):
        found = here[_nearest(cells.centres[here], cells.centres[here]).reshape(len(here), -1)]
        near[here, : found.shape[1]] = found
    return near


def _hidden(cells: AdaptivePatches, some: IntArray, near: IntArray) -> BoolArray:
    """Which of the nearest patches of some are behind something, seen from right above them."""
    if cells.convex or not len(cells.occluders):
        return np.zeros(near.shape, dtype=bool)
    above = cells.centres + ABOVE * float(np.ptp(cells.vertices.reshape(-1, 3), axis=0).max()) * cells.normals
    begin = np.repeat(above[some], near.shape[1], axis=0)
    return segments_blocked(cells, begin, above[near].reshape(-1, 3)).reshape(near.shape)


def _nearest(points: FloatArray, among: FloatArray) -> IntArray:
    """(n, 9) indices of the nearest, themselves included."""
    return np.asarray(cKDTree(among).query(points, min(NEIGHBOURS + 1, len(among)))[1], dtype=np.intp)


def _fitted(
    cells: AdaptivePatches, some: IntArray, near: IntArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 3) gradients in the planes of some patches and (n,) weighted mean squares of what they leave."""
    centres, basis = cells.centres, _plane_axes(cells.normals[some])
    offset = np.einsum("pnk,pak->pna", centres[near] - centres[some, None], basis)
    squared = (offset**2).sum(axis=2)
    smooth = np.einsum("pnk,pk->pn", cells.normals[near], cells.normals[some]) > SMOOTH
    weight = np.divide(1.0, squared, out=np.zeros_like(squared), where=(squared > 0) & smooth)
    difference = values[near] - values[some, None]
    normal_matrix = np.einsum("pn,pni,pnj->pij", weight, offset, offset)
    right = np.einsum("pn,pni,pn->pi", weight, offset, difference)
    slope = np.einsum("pij,pj->pi", np.linalg.pinv(normal_matrix, rcond=1e-6, hermitian=True), right)
    left = (weight * (difference - np.einsum("pni,pi->pn", offset, slope)) ** 2).sum(axis=1)
    left /= np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    return np.einsum("pi,pik->pk", slope, basis), left


def _plane_axes(normals: FloatArray) -> FloatArray:
    """(n, 2, 3) two unit axes in each plane."""
    along = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = np.cross(normals, along)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([u, np.cross(normals, u)], axis=1)


def uniform_patches(whole: AdaptivePatches, count: int) -> AdaptivePatches:
    """Return patches of about equal size: quartered once, then halved until there are ``count``."""
    cells = whole.quarters()
    size_m = float(np.sqrt(cells.areas.sum() / count))
    while True:
        edges_m = np.linalg.norm(cells.edges, axis=2)
        large = (edges_m.max(axis=1) > 1.42 * size_m) & (cells.areas > 1.42 * size_m**2)
        if not large.any():
            return cells
        cells = joined(cells.chosen(~large), cells.chosen(large).halves(np.argmax(edges_m[large], axis=1)))


@dataclass(eq=False, kw_only=True)
class Refinement:
    """Patches on the way from the whole faces to the fewest that meet a goal."""

    probe: SolvedPatches
    light: Lighting
    cells: AdaptivePatches
    owner: IntArray
    """(patches of the probe,) the patch that each one's centre lies in."""
    example: IntArray
    """(P,) a patch of the probe that shows how the light varies here."""
    squared: FloatArray
    """(P,) squared error times area, of the irradiance's variation and of a light's edge [m²]."""
    along: IntArray
    """(P,) which way to halve each patch next."""

    @classmethod
    def start(cls, whole: AdaptivePatches, probe: SolvedPatches, light: Lighting) -> Refinement:
        """Return a refinement that begins with the whole faces."""
        owner = probe.cells.whole.copy()
        example = np.zeros(whole.n_patches, dtype=np.intp)
        example[owner] = np.arange(len(owner))
        nothing = np.zeros(0)
        start = cls(
            probe=probe,
            light=light,
            cells=whole,
            owner=owner,
            example=example,
            squared=nothing,
            along=nothing.astype(np.intp),
        )
        start.squared, start.along = start._judged(whole, np.arange(whole.n_patches))
        return start

    @property
    def error(self) -> float:
        """RMS over the surface; 1 = white."""
        return float(np.sqrt(self.squared.sum() / self.cells.areas.sum()))

    def measured_error(self, irradiance: FloatArray) -> float:
        """Return the RMS over the surface of a solution on these patches, (P,) irradiance, against the probe's."""
        probe = self.probe
        difference = probe.irradiance - irradiance[self.owner]
        squared = probe.cells.reflectance**2 * (probe.cells.areas * difference**2 + probe.within)
        return float(np.sqrt(squared.sum() / probe.cells.areas.sum()))

    def refine(self, error: float, most_cells: int) -> None:
        """Halve the worst patches until the error or the number of patches is reached."""
        goal = error**2 * float(self.cells.areas.sum())
        while self.squared.sum() > goal and self.cells.n_patches < most_cells:
            order = np.argsort(self.squared)[::-1]
            worst = self.squared[order]
            enough = int(np.searchsorted(0.6 * np.cumsum(worst), self.squared.sum() - goal)) + 1
            count = min(enough, int((worst > worst[0] / 2).sum()), most_cells - self.cells.n_patches)
            self._halve(np.sort(order[:count]))

    def _halve(self, chosen: IntArray) -> None:
        count = self.cells.n_patches
        kept = np.ones(count, dtype=bool)
        kept[chosen] = False
        children = self.cells.chosen(chosen).halves(self.along[chosen])
        place = np.cumsum(kept) - 1
        place[chosen] = kept.sum() + np.arange(len(chosen))
        moving = np.flatnonzero(~kept[self.owner])
        self.owner = place[self.owner]
        child = self.owner[moving] - int(kept.sum())
        self.owner[moving] += len(chosen) * _in_second_half(children, child, self.probe.cells.centres[moving])
        self.example = np.concatenate([self.example[kept], np.tile(self.example[chosen], 2)])
        self.example[self.owner[moving]] = moving
        self.cells = joined(self.cells.chosen(kept), children)
        new = np.arange(int(kept.sum()), self.cells.n_patches)
        squared, along = self._judged(children, new)
        self.squared = np.concatenate([self.squared[kept], squared])
        self.along = np.concatenate([self.along[kept], along])

    def _judged(self, cells: AdaptivePatches, index: IntArray) -> tuple[FloatArray, IntArray]:
        """Squared error of some cells, ``index`` their place among all, and which way to halve them."""
        spread, along_u, along_v = self._spread(cells, index)
        edge = squared_light_edges(cells, emission(cells, self.light).variance, self.probe.cells)
        lengths = np.linalg.norm(cells.edges, axis=2)
        longer = np.argmax(lengths, axis=1)
        stretched = lengths.max(axis=1) > LONGEST_ASPECT * lengths.min(axis=1)
        along = np.where(stretched | (edge > spread), longer, (along_v > along_u).astype(np.intp))
        return cells.reflectance**2 * (spread + edge), along

    def _spread(self, cells: AdaptivePatches, index: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Squared variation of the irradiance over patches, and its part along u and v."""
        probe, n = self.probe, self.cells.n_patches
        example = self.example[index]
        count = np.bincount(self.owner, minlength=n)[index]
        weight = probe.cells.areas
        area, first, second, within = (
            np.bincount(self.owner, weight * part, minlength=n)[index]
            for part in (1.0, probe.irradiance, probe.irradiance**2, probe.within / weight)
        )
        inside = np.maximum(area, 1e-300)
        several = (np.maximum(second - first**2 / inside, 0.0) + within) * cells.areas / inside
        rough = probe.roughness[example]
        alone = cells.variation(probe.gradient[example]) + rough * cells.polar_moments
        spread = np.where(count > 1, several, alone)
        along = []
        for axis in (0, 1):
            edge = cells.edges[:, axis]
            alone = np.einsum("pk,pk->p", edge, probe.gradient[example]) ** 2 + rough * (edge**2).sum(axis=1)
            tensor = np.zeros(len(index))
            for i in range(3):
                for j in range(3):
                    product = weight * probe.gradient[:, i] * probe.gradient[:, j]
                    tensor += edge[:, i] * edge[:, j] * np.bincount(self.owner, product, minlength=n)[index]
            along.append(np.where(count > 1, tensor / inside, alone))
        return spread, along[0], along[1]


def squared_light_edges(cells: AdaptivePatches, variance: FloatArray, among: AdaptivePatches) -> FloatArray:
    """Return the squared error of the irradiance times area that light's edges inside patches make.

    Parameters
    ----------
    cells : AdaptivePatches
    variance : (P,) array
        Of the light within each, as :func:`sim.light.lighting.emission` gives it.
    among : AdaptivePatches
        Of the whole scene, on whose planes the edges' light may fall.

    Returns
    -------
    (P,) array
        [m²]
    """
    cut = np.flatnonzero(variance > 1e-12)
    error = np.zeros(cells.n_patches)
    if len(cut):
        near = cells.areas[cut] / np.maximum(_distance(cells.centres[cut], cells.region[cut], among), 1e-9) ** 2
        error[cut] = SOURCE_WEIGHT * cells.areas[cut] * variance[cut] * np.minimum(1.0, near**2)
    return error


def _distance(points: FloatArray, region: IntArray, among: AdaptivePatches) -> FloatArray:
    """(N,) distance to the nearest plane of another region that the points lie before [m]."""
    regions, first = np.unique(among.region, return_index=True)
    nearest = np.full(len(points), np.inf)
    for number, example in list(zip(regions, first, strict=True))[:MOST_PLANES]:
        height = (points - among.centres[example]) @ among.normals[example]
        nearest = np.where((region != number) & (height > 0), np.minimum(nearest, height), nearest)
    return nearest


def _in_second_half(children: AdaptivePatches, child: IntArray, points: FloatArray) -> BoolArray:
    """(N,) True where a point lies beyond the cut of the pair of halves ``child`` and ``child + pairs``."""
    first = children.vertices[child]
    normal = children.normals[child]
    across = np.cross(normal, first[:, 2] - first[:, 1])
    inner = np.einsum("nk,nk->n", across, first[:, 0] - first[:, 1])
    here = np.einsum("nk,nk->n", across, points - first[:, 1])
    return np.asarray(here * inner < 0)
