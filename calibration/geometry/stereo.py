"""Self-calibration of a camera and a projector from dense correspondences in a room with flat walls.

Three stages. (1) Epipolar: relative pose from the essential matrix, refined over focal lengths, distortion and
lens shift, held by the data sheets: with optical axes that nearly meet, two views do not determine the focal
lengths. (2) The triangulated points are split into planes. (3) Plane-constrained bundle adjustment: every point
lies on its plane, so a correspondence gives two equations and no unknown; walls at right angles fix the focal
lengths, and all terms of both lenses become determined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import PlanarScene, lens_sigmas, scene_of
from calibration.geometry.contradictions import hold_against_all
from calibration.geometry.flat.averaging import without_averaging
from calibration.geometry.flat.depth_reversal import likelier_depths
from calibration.geometry.flat.one_wall import fit_where_flat
from calibration.geometry.flat.rivals import uncontradicted_rival, with_square_walls
from calibration.geometry.flat.third_wall import WeighedPoints, weights_of, with_third_wall
from calibration.geometry.known.contradiction import OtherLens, contradiction, hold_against_boards
from calibration.geometry.known.explained import ExplainedPixels
from calibration.geometry.known.lenses import KnownLenses
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.known.right_angles import by_askew_walls, found_square
from calibration.geometry.noise import standard_deviations
from calibration.geometry.pinhole import PinholeModel, points_on_planes, project
from calibration.geometry.plane_bundle import BundleSolution
from calibration.geometry.planes import Axes
from calibration.geometry.support import explained_within_px, plane_errors_px

MIN_POINTS = 500
"""Correspondences: below, a wall with 2 % of them has ten."""
_MANY = 10000
"""Points that the result rests on."""
_CLOSER = 4
"""Times as many points as the fit's are looked through for such as lie on no wall: of a strip there are few."""
_OTHERS = 12
"""Fits that are tried after the first was refused."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Uncertainty:
    """Covariance of a fit's unknowns, and how a calibration follows from them."""

    unknowns: FloatArray
    """(n,)"""
    covariance: FloatArray
    """(n, n)"""
    askew: FloatArray
    """(n, n) beside it, were each wall that is taken to be square off by 0.3 degrees."""
    axes: Axes
    nominal: NominalIntrinsics

    def scene(self, unknowns: FloatArray) -> PlanarScene:
        """Devices and planes of other unknowns; the baseline is 1."""
        return scene_of(unknowns, self.axes, self.nominal)


@dataclass(frozen=True, eq=False, kw_only=True)
class StereoCalibration:
    """Both devices in the camera's frame, and the planes that they saw."""

    camera: PinholeModel
    projector: PinholeModel
    planes: FloatArray
    """(K, 3) each plane as normal / offset: points with plane · x = 1; 1/m once scaled."""
    axes: tuple[int, ...]
    """Axis of the room (0, 1, 2) that each plane is perpendicular to; -1 for a plane that fits none."""
    room_axes: FloatArray
    """(3, 3) rows: the room's three directions in the camera's frame."""
    rms_px: float
    camera_rms_px: float
    projector_rms_px: float
    sigmas: dict[str, float]
    """Standard deviations of the free lens terms, from the fit's curvature. [px or 1]"""
    inlier_share: float
    explained: ExplainedPixels
    """The projector's pixels whose plane is known."""
    uncertainty: Uncertainty | None = None
    """Of everything together; None of a calibration that was not fitted."""
    notes: str = ""
    """What it rests on beside the points, in words."""
    right_angle_sigmas: float | None = None
    """By how much the points and the data sheets speak against right angles; None where none were taken."""
    bow: float = 0.0
    """Root mean square by which the wall bows that does most, 0 where all are flat; in metres once scaled."""

    @property
    def baseline(self) -> float:
        """Distance of the two centres of projection in metres; 1 until scaled."""
        return float(np.linalg.norm(self.projector.position_m - self.camera.position_m))

    def sigmas_of(self, figures: Callable[[StereoCalibration], FloatArray]) -> FloatArray:
        """Carry the fit's covariance into any figures that follow from a calibration.

        Parameters
        ----------
        figures : callable
            Of a calibration whose baseline is 1, (m,); it may bring it into metres first.

        Returns
        -------
        (m,)
            Standard deviations; zeros of a calibration that was not fitted.
        """
        if self.uncertainty is None:
            return np.zeros_like(figures(self))
        known = self.uncertainty
        return standard_deviations(lambda z: figures(self.at(z)), known.unknowns, known.covariance)

    def at(self, unknowns: FloatArray) -> StereoCalibration:
        """Return the calibration of other unknowns of its uncertainty, (n,); the baseline is 1."""
        known = self.uncertainty
        if known is None:
            raise CalibrationError("a calibration that was not fitted has no unknowns: fit it first (calibrate_stereo)")
        scene = known.scene(unknowns)
        return replace(
            self,
            camera=scene.camera,
            projector=scene.projector,
            planes=scene.planes,
            room_axes=scene.axes.directions,
        )

    def known_to(self, unknowns: FloatArray, covariance: FloatArray, askew: FloatArray) -> StereoCalibration:
        """Return the calibration of other unknowns (n,), and with other covariances of them (n, n)."""
        known = self.uncertainty
        if known is None:
            return self
        sigmas = lens_sigmas(covariance, known.nominal)
        other = replace(known, unknowns=unknowns, covariance=covariance, askew=askew)
        return replace(self.at(unknowns), sigmas=sigmas, uncertainty=other)


def calibrate_stereo(
    camera_xy_px: FloatArray,
    projector_xy_px: FloatArray,
    nominal: NominalIntrinsics,
    *,
    right_angles: bool = True,
    askew_deg: float = 0.0,
    one_wall: bool = False,
    sigma_px: FloatArray | None = None,
    beside: int = 0,
    averaged_px2: float = 0.0,
    on_step: Callable[[int, int], None] | None = None,
) -> StereoCalibration:
    """Find lenses, relative pose and planes from correspondences; the unit of length is the baseline.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Corresponding pixels. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    right_angles : bool
        Planes that are nearly perpendicular are so.
    askew_deg : float
        By which they are not exactly so: standard deviation of each of a plane's two tilts. [degrees]
    one_wall : bool
        One flat wall may be all that there is: lenses then rest on the data sheets.
    sigma_px : (N, 2), optional
        Standard deviation of the projector's pixels: those that are less certain than most count less. [px]
    beside : int
        So many of the last points lie beside edges: a strip of floor or ceiling may be found in them, but no wall.
    averaged_px2 : float
        Variance of the camera's window over which the projector's pixels are means; 0: they are not. [px²]
    on_step : callable, optional
        Called with the steps done and all steps.

    Returns
    -------
    StereoCalibration
        In the camera's frame, baseline 1.

    Raises
    ------
    CalibrationError
        Too few points, too little parallax, one plane that may not be all, or no planes that explain the points.

    References
    ----------
    R. Hartley and A. Zisserman, Multiple View Geometry, 2nd edition, Cambridge 2004, chapters 9 and 11 (epipolar
    geometry); B. Triggs et al., Bundle adjustment - a modern synthesis, 1999.
    """
    n_inside = len(camera_xy_px) - beside
    _check_count(n_inside)
    random = np.random.default_rng(0)
    order = np.concatenate([random.permutation(n_inside), n_inside + random.permutation(beside)])
    fitted = min(_MANY, n_inside)
    every = WeighedPoints(camera_xy_px[order], projector_xy_px[order], weights_of(sigma_px, order, usual_of=fitted))
    report = on_step or (lambda _done, _total: None)
    seen = partial(_calibrated, every, fitted=fitted, averaged_px2=averaged_px2)
    walls = partial(found_square, right_angles=right_angles, askew_deg=askew_deg)
    how = partial(seen, walls=walls, one_wall=one_wall, report=report)
    if nominal.sheets is None:
        return how(nominal)
    try:
        return how(nominal, others=0)
    except OtherLens:
        raise
    except CalibrationError as error:
        _refuse_other_lens(partial(how, others=0), nominal.sheets, nominal.known, error)
    return how(nominal)


def _refuse_other_lens(
    how: Callable[[NominalIntrinsics], StereoCalibration],
    sheets: NominalIntrinsics,
    known: KnownLenses,
    error: CalibrationError,
) -> None:
    """Raise OtherLens if lenses by boards are why nothing fits: with data sheets all does, and contradicts them."""
    try:
        found = how(sheets).uncertainty
    except CalibrationError:
        return
    told = "" if found is None else contradiction(found.unknowns, found.covariance, sheets, known)
    if told:
        raise OtherLens(told) from error


def _calibrated(
    every: WeighedPoints,
    nominal: NominalIntrinsics,
    *,
    fitted: int,
    walls: Callable[..., Iterator[BundleSolution]],
    one_wall: bool,
    report: Callable[[int, int], None],
    averaged_px2: float,
    others: int = _OTHERS,
) -> StereoCalibration:
    """Fit what is seen: one wall, or several."""
    x1, x2, weight = every.camera_xy_px[:fitted], every.projector_xy_px[:fitted], every.weight[:fitted]
    flat = fit_where_flat(x1, x2, nominal, weight=weight, one_wall=one_wall)
    if flat is not None:
        return replace(_finished(flat.solution, x1, x2, nominal), notes=flat.notes)
    report(1, 3)
    bundles = walls(x1, x2, nominal)
    first = next(bundles)
    report(2, 3)
    x2 = without_averaging(x1, x2, first, averaged_px2)
    try:
        final = hold_against_all(x1, x2, first, nominal, weight=weight)
    except CalibrationError as why:
        rest = islice(bundles, others)
        rival = uncontradicted_rival(x1, x2, first, rest, why=why, nominal=nominal, weight=weight)
        if rival is None:
            raise
        final = rival
    final = with_square_walls(x1, x2, final, nominal=nominal, weight=weight)
    hold_against_boards(final)
    whole = without_averaging(every.camera_xy_px, every.projector_xy_px, final, averaged_px2)
    points = replace(every, projector_xy_px=whole)
    resting = with_third_wall(final, points, nominal, n_fitted=fitted)
    resting = likelier_depths(final, resting, points, nominal, n_fitted=fitted)
    report(3, 3)
    found = _finished(resting.solution, resting.points.camera_xy_px, resting.points.projector_xy_px, nominal)
    explained = found.explained.with_others(_on_no_plane(resting.solution, points, fitted=fitted))
    return replace(found, right_angle_sigmas=final.right_angle_sigmas, explained=explained)


def _on_no_plane(solution: BundleSolution, points: WeighedPoints, *, fitted: int) -> FloatArray:
    """(N, 2) projector pixels that no plane explains, of points beyond those of the fit.

    Points beside edges are among them: a strip of a wall that the camera hardly sees is nothing else.
    """
    left = slice(fitted, None, max(1, len(points.weight) // (_CLOSER * fitted)))
    x1, x2 = points.camera_xy_px[left], points.projector_xy_px[left]
    errors = plane_errors_px(solution, x1, solution.straightened(x1, x2)).min(axis=0)
    return x2[errors > explained_within_px(errors)] if len(errors) else x2


def _check_count(n: int) -> None:
    if n < MIN_POINTS:
        raise CalibrationError(
            f"{n} correspondences, at least {MIN_POINTS} are needed: look at exposure, focus and how much of "
            "the projector's picture the camera sees"
        )


def _finished(bundle: BundleSolution, x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics) -> StereoCalibration:
    used = bundle.label >= 0
    planes = bundle.planes[bundle.label[used]]
    camera, projector = bundle.camera, bundle.projector
    projector_rms = _rms(project(projector, points_on_planes(camera, x1[used], planes)) - x2[used])
    camera_rms = _rms(project(camera, points_on_planes(projector, x2[used], planes)) - x1[used])
    return StereoCalibration(
        camera=camera,
        projector=projector,
        planes=bundle.planes,
        axes=tuple(int(a) for a in bundle.axes.of_plane),
        room_axes=bundle.axes.directions,
        rms_px=float(np.sqrt((camera_rms**2 + projector_rms**2) / 2)),
        camera_rms_px=camera_rms,
        projector_rms_px=projector_rms,
        sigmas=lens_sigmas(bundle.covariance, nominal),
        inlier_share=float(used.mean()),
        explained=ExplainedPixels(projector_xy_px=x2[used], plane=bundle.label[used], others_xy_px=x2[~used]),
        bow=0.0 if bundle.bows is None else bundle.bows.most,
        uncertainty=Uncertainty(
            unknowns=bundle.fit.z,
            covariance=bundle.covariance,
            askew=by_askew_walls(bundle),
            axes=bundle.start_axes,
            nominal=nominal,
        ),
    )


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))
