"""Walls that are not quite flat: plaster bows by millimetres, and a camera with many pixels sees that.

Held for flat, a room whose walls bow by 5 mm bends its lenses: at 320 x 240 the ceiling was 3 sigma off, at
960 x 720 the walls were told to stand at no right angles. So each wall may bow, smoothly and a little; how much, the
points tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.geometry.bundle_residual import LandingError, landed, rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.noise import inverse_of, observation_variance
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.robust_fit import Fit

_BENT = 2
_DEGREE = np.array([degree for degree in range(5) for _ in range(degree + 1)])
"""Of each term, a product of Legendre polynomials over a wall, and the first that bends it; more, no one tells from
noise. Of a wall that bows, what is seen lies a little beside where it ought to stand, and a little askew, too: 0, 1."""
_FALL = (3 / (_DEGREE + 1)) ** 1.5
"""By how much terms go further than those of degree 2, which bend a wall most simply: as of plaster, which DIN 18202
lets be uneven by twice as much over four times the length (5 mm in 1 m, 10 mm in 4 m)."""
_LEAST_ON_WALL = 60
"""Points of a wall: fewer tell nothing of fifteen terms."""
_RIM = 0.005
"""Share of a wall's points beyond its extent, on each side: strays would stretch it."""
_SPREADS = np.geomspace(1e-5, 0.006, 30)[:, None] * _FALL
"""Standard deviations of terms that are tried, in roots of the wall's extent, all in baselines."""
_ASKEW = _SPREADS * (_DEGREE < _BENT)
"""Those of flat walls that are askew."""
_LEANING = np.concatenate([_SPREADS * np.where(_DEGREE == 1, times, 1.0) for times in (3.0, 6.0)])
_MOST_LEANING = 6.0
"""Spreads of walls that lean further than they bow, and what log evidence may be for these. For square walls that bow,
of nine random rigs: at most 3.6. For six rooms that bow by 4 mm and stand 0.3 degrees askew: 0.7 to 36, and 9 to 36
where what rests on their being square is more than 3.5 sigma off."""
_LEAST_GAIN = 2.0
"""Of log evidence: bows are seven times as likely as none. Flat walls of simulated rooms: mostly -6 to 0.8; such as bow
by 8 mm: 3 at 320 x 240; by 5 mm: 7 there, 2300 at 960 x 720. Of 8 mm that were not believed, a turn was 5 sigma off."""
_MOST_BOW = 0.003
"""Root mean square by which a wall leaves its plane, over its extent: 12 mm in 4 m, where DIN 18202 lets plaster be
uneven by 10 mm at most. A facet for a cylinder bows by 0.009 where it is a quarter of the radius wide."""
_ROUNDS, _SETTLED = 8, 0.05
"""Of finding the noise beside the bows, and its change at which that ends."""
_REACH_PX = 1.5
"""Within which a bowed wall explains a point."""
_ROUNDING = 1e-9
"""Of the largest curvature."""
_STEP = 1e-4
"""Of a point's distance, by which a wall is moved to see what that does."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _BowedWall:
    """A wall's plane, and the rectangle of it in which points lie."""

    plane: FloatArray
    """(3,) normal / offset."""
    along: FloatArray
    """(2, 3) two directions along it."""
    middle: FloatArray
    half: FloatArray
    """(2,) of the rectangle, along both. [baselines]"""

    @classmethod
    def of(cls, plane: FloatArray, rays: FloatArray) -> _BowedWall:
        """Return the wall of which rays (N, 3) meet so much."""
        normal = plane / np.linalg.norm(plane)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        along = np.stack([first, np.cross(normal, first)])
        low, high = np.quantile(rays / (rays @ plane)[:, None] @ along.T, (_RIM, 1 - _RIM), axis=0)
        return cls(plane=plane, along=along, middle=(low + high) / 2, half=np.maximum((high - low) / 2, 1e-9))

    @property
    def extent(self) -> float:
        """Side of a square of its area. [baselines]."""
        return float(2 * np.sqrt(np.prod(self.half)))

    def heights(self, rays: FloatArray) -> FloatArray:
        """(N, m) by which each term lets the wall stand further out where rays meet it."""
        place = rays / (rays @ self.plane)[:, None] @ self.along.T
        by_u, by_v = (_polynomials(x) for x in np.clip((place - self.middle) / self.half, -1, 1).T)
        first = np.concatenate([np.arange(degree + 1) for degree in range(_DEGREE[-1] + 1)])
        return np.asarray(np.sqrt(self.extent) * by_u[:, first] * by_v[:, _DEGREE - first])

    def moves_px(self, projector: PinholeModel, rays: FloatArray) -> FloatArray:
        """(N, 2, m) by which each term moves the projector's pixels."""
        along = rays @ self.plane
        further = landed(projector, rays, along / (1 + _STEP * np.linalg.norm(self.plane)))
        slope = (further - landed(projector, rays, along)) / _STEP
        return np.asarray(slope[:, :, None] * self.heights(rays)[:, None, :])


def _polynomials(x: FloatArray) -> FloatArray:
    """(N, 5) Legendre polynomials, each of mean square 1."""
    return np.asarray(
        np.polynomial.legendre.legvander(x, int(_DEGREE[-1])) * np.sqrt(2 * np.arange(_DEGREE[-1] + 1) + 1)
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Bows:
    """How the walls of a scene bow, and how far such bows go at all."""

    scene: PlanarScene
    """With the planes that they are told from."""
    walls: tuple[_BowedWall | None, ...]
    """Of each plane; None of one with few points."""
    terms: tuple[FloatArray, ...]
    """(m,) of each plane."""
    spread: FloatArray
    """(m,) standard deviations of a wall's terms, in roots of its extent. [baselines^½]"""
    variance_px2: float
    """Of an independent observation beside them. [px²]"""
    variance_as_flat_px2: float
    """The same with what they move pixels by. [px²]"""

    @property
    def most(self) -> float:
        """Root mean square by which the wall bows that does most. [baselines]."""
        both = zip(self.walls, self.terms, strict=True)
        return max(float(np.sqrt(wall.extent) * np.linalg.norm(own[_DEGREE >= _BENT])) for wall, own in both if wall)

    def straightened(self, camera_xy_px: FloatArray, projector_xy_px: FloatArray) -> FloatArray:
        """Return projector pixels (N, 2) as flat walls would have them; of points that are on no wall as they were."""
        rays = rays_of(self.scene.camera, camera_xy_px)
        moved = np.stack([self._moved_px(k, rays) for k in range(len(self.walls))])
        there = np.stack([landed(self.scene.projector, rays, rays @ plane) for plane in self.scene.planes])
        ahead = np.stack([rays @ plane > 0 for plane in self.scene.planes])
        off = np.where(ahead, np.linalg.norm(there + moved - projector_xy_px, axis=2), np.inf)
        best, every = off.argmin(axis=0), np.arange(len(rays))
        shift = np.where((off[best, every] < _REACH_PX)[:, None], moved[best, every], 0.0)
        return np.asarray(projector_xy_px - shift)

    def _moved_px(self, k: int, rays: FloatArray) -> FloatArray:
        wall = self.walls[k]
        return np.zeros((len(rays), 2)) if wall is None else wall.moves_px(self.scene.projector, rays) @ self.terms[k]


def bows_of(scene: PlanarScene, fit: Fit, error: LandingError) -> Bows | None:
    """Find how the walls of a fit bow; None where they are flat, as far as its points tell, or no walls at all.

    Terms of bows are normally distributed about 0; how widely, and what noise is beside them, is most likely of all
    where both are integrated over, with the fit's unknowns (the evidence: D. MacKay, Bayesian interpolation, 1992).

    Parameters
    ----------
    scene : PlanarScene
        Where the fit ends.
    fit : Fit
    error : LandingError
        What it minimised.

    Returns
    -------
    Bows or None
        None, too, where a wall bows by more than 0.3 % of its extent, or where walls lean that ought to be square, by
        more than bows explain: what that is, is not told here.
    """
    normal = _BowsInFit.of(scene, fit, error)
    if normal is None:
        return None
    variance, likeliest = _settled(normal, fit, error)
    terms = normal.by_wall(likeliest.terms)
    is_likely = likeliest.gain > _LEAST_GAIN and likeliest.leaning < _MOST_LEANING
    if not is_likely or max(map(_share, normal.walls, terms)) > _MOST_BOW:
        return None
    return Bows(
        scene=scene,
        walls=normal.walls,
        terms=terms,
        spread=likeliest.spread,
        variance_px2=variance,
        variance_as_flat_px2=observation_variance(fit, error.x1, error.label, error.x2),
    )


def _share(wall: _BowedWall | None, terms: FloatArray) -> float:
    """Root mean square by which a wall leaves its plane, as a share of its extent."""
    return 0.0 if wall is None else float(np.linalg.norm(terms[_DEGREE > 0]) / np.sqrt(wall.extent))


def taken_by_bows(scene: PlanarScene, fit: Fit, error: LandingError, spread: FloatArray) -> FloatArray:
    """Return what bows take from the curvature (n, n) of a fit: of what they may explain it says less.

    Parameters
    ----------
    scene : PlanarScene
        Where the fit ends.
    fit : Fit
        Whose priors were weighed by the variance of an independent observation.
    error : LandingError
        What it minimised.
    spread : (m,)
        Of :class:`Bows`.

    Returns
    -------
    (n, n)
    """
    normal = _BowsInFit.of(scene, fit, error)
    if normal is None:
        return np.zeros_like(fit.hessian)
    held = normal.own + np.diag(fit.priors.weight / normal.of_all(spread) ** 2)
    return np.asarray(normal.shared @ np.linalg.solve(held, normal.shared.T))


@dataclass(frozen=True, eq=False, kw_only=True)
class BowOfOne:
    """How a single wall bows, as far as the lenses and the pose of a fit that holds it for flat leave it."""

    is_likely: bool
    share: float
    """Root mean square, as a share of the wall's extent."""
    moved: FloatArray
    """(n, n) covariance that it brings to the fit's unknowns, as far as these move evenly with it."""
    cost: float
    """Of the fit beside it. [px²]"""


def bow_of_one_wall(scene: PlanarScene, fit: Fit, error: LandingError) -> BowOfOne | None:
    """Find how a single wall bows; nothing tells what the lenses and the pose took up of that.

    Parameters
    ----------
    scene : PlanarScene
        Where the fit ends, with one plane.
    fit : Fit
    error : LandingError
        What it minimised.

    Returns
    -------
    BowOfOne or None
        None where too few points are on it.
    """
    normal = _BowsInFit.of(scene, fit, error)
    if normal is None:
        return None
    (wall,) = normal.walls
    variance, likeliest = _settled(normal, fit, error)
    # Where the wall stands and how it is turned is free: only what bends it moves the others.
    spread = likeliest.spread * (_DEGREE >= _BENT)
    moves = inverse_of(fit.hessian) @ normal.shared * normal.of_all(spread)
    return BowOfOne(
        is_likely=likeliest.gain > _LEAST_GAIN,
        share=_share(wall, spread),
        moved=np.asarray(moves @ moves.T),
        cost=fit.cost - 2 * variance * max(likeliest.gain, 0.0),
    )


def _settled(normal: _BowsInFit, fit: Fit, error: LandingError) -> tuple[float, _Likeliest]:
    """The variance of an independent observation beside the likeliest bows, and these."""
    # From below: beside what bows leave in the residuals of flat walls, none are seen.
    variance = float(np.square(fit.residual * fit.weight[:, None]).mean())
    for _ in range(_ROUNDS):
        likeliest = normal.likeliest(variance)
        now = observation_variance(replace(fit, residual=likeliest.residual), error.x1, error.label, error.x2)
        settled, variance = abs(now / variance - 1) < _SETTLED, now
        if settled:
            break
    return variance, likeliest


@dataclass(frozen=True, eq=False, kw_only=True)
class _Likeliest:
    """How far bows most likely go, and what follows."""

    spread: FloatArray
    gain: float
    """Of log evidence, over walls that are flat, if askew."""
    leaning: float
    """Of log evidence for walls that lean further than they bow, over these."""
    terms: FloatArray
    residual: FloatArray
    """(N, 2) that is left beside them. [px]"""


@dataclass(frozen=True, eq=False, kw_only=True)
class _BowsInFit:
    """Terms of all walls' bows beside the unknowns of a fit: the normal equations that both have."""

    fit: Fit
    walls: tuple[_BowedWall | None, ...]
    rays: FloatArray
    label: IntArray
    columns: FloatArray
    """(N, 2, m) derivative of the weighted residuals by each term."""
    own: FloatArray
    """(m, m) curvature by the terms."""
    shared: FloatArray
    """(n, m) by the unknowns and the terms."""

    @classmethod
    def of(cls, scene: PlanarScene, fit: Fit, error: LandingError) -> _BowsInFit | None:
        """Return those of a fit; None where no wall has enough points."""
        rays, label = rays_of(scene.camera, error.x1), error.label
        enough = np.bincount(label, minlength=len(scene.planes)) >= _LEAST_ON_WALL
        walls = tuple(
            _BowedWall.of(plane, rays[label == k]) if enough[k] else None for k, plane in enumerate(scene.planes)
        )
        if not enough.any():
            return None
        parts = [(label == k, wall) for k, wall in enumerate(walls) if wall is not None]
        blocks = [np.zeros((len(rays), 2, 0))]
        for on, wall in parts:
            moves = wall.moves_px(scene.projector, rays[on])
            blocks.append(np.zeros((len(rays), 2, moves.shape[2])))
            blocks[-1][on] = moves
        columns = np.concatenate(blocks, axis=2) * np.broadcast_to(error.weight, fit.residual.shape)[:, :, None]
        weighted = columns * fit.weight[:, None, None]
        own = np.tensordot(columns, weighted, ((0, 1), (0, 1)))
        shared = np.tensordot(fit.jacobian, weighted, ((1, 2), (0, 1)))
        return cls(fit=fit, walls=walls, rays=rays, label=label, columns=columns, own=own, shared=shared)

    @cached_property
    def _pull(self) -> FloatArray:
        """(m,) slope of half the cost by the terms."""
        return np.tensordot(self.columns, self.fit.residual * self.fit.weight[:, None], ((0, 1), (0, 1)))

    def likeliest(self, variance_px2: float) -> _Likeliest:
        """Return what is most likely beside a noise; the fit's priors count as they do against that."""
        priors, fit = self.fit.priors, self.fit
        # Of weighted residuals: a robust fit's curvature is less by the weights once, their squares by them twice.
        variance_px2 = variance_px2 / float(fit.weight.mean())
        lighter = variance_px2 - priors.weight
        slope = lighter * priors.precision @ (fit.z - priors.expected)
        inverse = inverse_of(fit.hessian + lighter * priors.precision)
        values, vectors = np.linalg.eigh(self.own - self.shared.T @ inverse @ self.shared)
        # Of what the unknowns take up altogether, rounding leaves something.
        open_ = values > _ROUNDING * values.max()
        values, vectors = values[open_], vectors[:, open_]
        curvature = vectors * values @ vectors.T
        pull = vectors @ vectors.T @ (self._pull - self.shared.T @ inverse @ slope)
        gains, askew, leaning = (
            np.array([_evidence(curvature, pull, self.of_all(spread), variance_px2)[0] for spread in spreads])
            for spreads in (_SPREADS, _ASKEW, _LEANING)
        )
        likely = np.exp(gains - gains.max())
        spread = np.sqrt(likely @ _SPREADS**2 / likely.sum())
        _, terms = _evidence(curvature, pull, self.of_all(spread), variance_px2)
        moved = -inverse @ (self.shared @ terms + slope)
        residual = fit.residual + np.tensordot(moved, fit.jacobian, 1) + self.columns @ terms
        return _Likeliest(
            spread=spread,
            gain=float(gains.max() - max(0.0, askew.max())),
            leaning=float(leaning.max() - gains.max()),
            terms=terms,
            residual=residual,
        )

    def of_all(self, spread: FloatArray) -> FloatArray:
        """Return the standard deviations of all walls' terms."""
        return np.tile(spread, len(self.own) // len(_DEGREE))

    def by_wall(self, terms: FloatArray) -> tuple[FloatArray, ...]:
        """Return the terms of all walls wall by wall; none of walls with few points."""
        ends = np.cumsum([len(_DEGREE) * (wall is not None) for wall in self.walls])[:-1]
        return tuple(np.split(terms, ends))


def _evidence(
    curvature: FloatArray, pull: FloatArray, spread: FloatArray, variance_px2: float
) -> tuple[float, FloatArray]:
    """Log evidence for terms (m,) of some spread (m,), over none, and the most likely terms."""
    held = np.linalg.cholesky(np.eye(len(spread)) + curvature * np.outer(spread, spread) / variance_px2)
    towards = np.linalg.solve(held, spread * pull / variance_px2)
    gain = float(towards @ towards) / 2 - float(np.log(np.diag(held)).sum())
    return gain, -spread * np.linalg.solve(held.T, towards)
