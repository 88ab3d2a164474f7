"""What a session knows of its rig, as far as a re-check needs it: map, devices, walls, light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.moved.records import SeenWalls
from calibration.geometry.pinhole import PinholeModel
from calibration.structured_light.correspondence import Correspondence
from rig.errors import SessionError
from rig.session import Session, Step
from rig.session.folder import typed
from rig.stages.correspondence import load_correspondence, only
from rig.stages.geometry import Point, load_geometry
from rig.stages.light.unseen_walls import shift_of
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.model import load_model_record, load_standing
from rig.stages.photograph import frame_name
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import posed_lens
from rig.stages.surface.scene import AnyScene, scene_of
from sim.geometry.optics import rays_at
from sim.geometry.rays import trace

FloatArray = NDArray[np.float64]

_STANDING = "what stands before the walls"
_NO_SHIFT: Point = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownRig:
    """Where everything stood when a session was calibrated."""

    camera: PinholeModel
    projector: PinholeModel
    scene: AnyScene
    walls: tuple[str, ...]
    """Names of the scene's first regions; what comes after them stands before these."""
    map: Correspondence
    radiometric: RadiometricCalibration
    white: FloatArray
    """(H, W) light of projector white above black, all bands together. [full scale]"""
    black: FloatArray
    """(H, W) light while the projector showed black."""

    def seen_by(self, camera: PinholeModel, xy_px: FloatArray) -> SeenWalls:
        """Return what pixels of a camera in this room see."""
        lens = posed_lens(camera)
        hits = trace(self.scene, lens.pose.position_m, rays_at(lens.lens, lens.pose, xy_px))
        patch = np.maximum(hits.patch, 0)
        normal = np.where((hits.patch >= 0)[:, None], self.scene.normals[patch], np.nan)
        corner = self.scene.vertices[patch, 0]
        label = np.where(hits.patch >= 0, hits.face, -1)
        return SeenWalls(normal, (normal * corner).sum(axis=1), label.astype(np.int64))

    def wall_name(self, label: int) -> str:
        """Return what a wall is called."""
        return self.walls[label] if label < len(self.walls) else _STANDING


def known_rig(session: Session) -> KnownRig:
    """Load what a calibrated session knows.

    Parameters
    ----------
    session
        With step `geometry` finished.

    Returns
    -------
    KnownRig

    Raises
    ------
    SessionError
        It is not calibrated.
    """
    if not session.is_finished("geometry"):
        raise SessionError(
            f"{session.path}: is not calibrated, so there is nothing to compare with; "
            f"run `rig run {typed(session.path)}`"
        )
    geometry, is_modelled = load_geometry(session), session.is_finished("model")
    shift_m = shift_of(load_model_record(session).placed) if is_modelled else _NO_SHIFT
    standing = load_standing(session) if is_modelled else None
    there = partial(_shifted, by_m=shift_m)
    radiometric = load_radiometric_calibration(session)
    white, black = light_of_flats(session.finished("gray"), radiometric)
    return KnownRig(
        camera=there(only(geometry.cameras).pinhole()),
        projector=there(only(geometry.projectors).pinhole()),
        scene=scene_of(geometry, session.profile.room.patch_size_m, standing),
        walls=geometry.surface.faces,
        map=load_correspondence(session),
        radiometric=radiometric,
        white=white,
        black=black,
    )


def _shifted(device: PinholeModel, by_m: Point) -> PinholeModel:
    return replace(device, translation_m=device.translation_m - device.rotation @ np.array(by_m))


def light_of_flats(gray: Step, radiometric: RadiometricCalibration) -> tuple[FloatArray, FloatArray]:
    """Return (H, W) light of white above black, and of black, from a step that photographed both."""
    table = radiometric.table()
    white, black = (
        table[gray.load_frame(frame_name(name)).pixels].sum(axis=2).astype(np.float64) for name in ("white", "black")
    )
    return white - black, black
