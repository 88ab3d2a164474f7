"""Whether whole sessions are ever wrong in silence, and whether what they state as sigma is true.

    python benchmarks/calibration/random_rigs.py --rigs 40 --seed 1 --keep FOLDER
    python benchmarks/calibration/session_coverage.py FOLDER

Reads what random_rigs.py kept: of every session that ended, each term of both lenses, the relative pose, the room, the
places of the devices, the camera's response and the projector's, against the truth of its profile.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from geometry_coverage import Outcome, compared, report
from response_coverage import judged

from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.optics import make_optics
from rig.errors import RigError
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.geometry import load_geometry
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.results import SessionResult
from rig.stages.surface.openings import SeenBehind


@dataclass(frozen=True)
class Judgement:
    """One session: its geometry, its response, and whether it called itself within limits."""

    geometry: Outcome
    response_sigmas: Sequence[float]
    """Error of the camera's light over its sigma, at the levels of response_coverage.py."""
    within_limits: bool
    place_percent: float
    """Largest sigma of a place, % of the room, as its page says."""
    askew_percent: float
    """What the least certain length or place is off by, if walls are 0.3 degrees askew; NaN where none is square."""


def judgement(folder: Path) -> Judgement:
    """Compare one finished session with the truth of its profile."""
    profile = Profile.parse((folder / "profile.toml").read_bytes(), folder / "profile.toml")
    session = Session.read(folder, profile)
    settings = profile.simulation
    if settings is None:
        raise ValueError(f"{folder}: not a simulated rig")
    camera = make_optics(settings.camera, profile.camera.shape[:2])
    projector = make_optics(settings.projector, profile.projector.shape)
    # A mesh file has a size of its own, and `size_m` does not count there.
    scene = find_scene(settings, folder.parent).triangles_m if settings.is_mesh_file else None
    size_m = np.array(settings.size_m) if scene is None else np.ptp(scene.reshape(-1, 3), axis=0)
    metrics = session.read_metrics(SessionResult)
    behind = () if metrics.model.standing is None else metrics.model.standing.behind
    # A mesh is as large as its niches are deep; what is measured of a wall is where it stands around them.
    sigmas = {name: value for name, value in metrics.geometry.sigmas.items() if name not in _walls(behind)}
    geometry = replace(load_geometry(session), sigmas=sigmas)
    outcome = compared(folder.name, geometry, (camera, projector), size_m)
    response = judged(profile, load_radiometric_calibration(session))
    told = {row.what: row.value for row in metrics.limits}
    return Judgement(
        geometry=outcome,
        response_sigmas=[float(score) for score in response.score],
        within_limits=metrics.within_limits,
        place_percent=told["geometry: uncertainty of the places of devices and surfaces"],
        askew_percent=next((value for what, value in told.items() if what.endswith("askew")), np.nan),
    )


def _walls(behind: Sequence[SeenBehind]) -> set[str]:
    return {f"surface_{one.face}_m" for one in behind}


def table(found: Mapping[str, Judgement], unfinished: Mapping[str, str]) -> str:
    """The distributions, and each session that was wrong although it said nothing."""
    ended = list(found.values())
    silent = [one.geometry for one in ended if one.within_limits]
    response = np.abs([one.response_sigmas for one in ended])
    lines = [f"{len(ended)} sessions ended, {len(silent)} within their limits; {len(unfinished)} refused"]
    lines += [f"  {name}: {why}" for name, why in unfinished.items()]
    lines += ["of those within limits:", report(silent), "of all that ended:", report([one.geometry for one in ended])]
    scores = np.abs([q for one in ended for q in one.geometry.sigmas_off.values()])
    if len(ended):
        lines += [
            f"all terms within 3 sigma: {(scores < 3).mean():.3f}, error over sigma {_typical(scores):.2f} (by median)",
            _askew([one for one in ended if one.within_limits]),
            f"light of the camera within 3 sigma: {(response < 3).mean():.3f}, {_typical(response):.2f} (by median)",
        ]
    return "\n".join(lines)


def _askew(within: Sequence[Judgement]) -> str:
    """What sessions within limits would be off by in rooms that are not square."""
    both = np.array([(one.askew_percent, one.place_percent) for one in within if np.isfinite(one.askew_percent)])
    if not len(both):
        return "walls 0.3 degrees askew: none within limits says what they would change"
    least, middle, most = np.quantile(both[:, 0], (0, 0.5, 1))
    return (
        f"walls 0.3 degrees askew would put the least certain place of those within limits off by {least:.2f} / "
        f"{middle:.2f} / {most:.2f} % of the room (least, median, most), stated sigma {np.median(both[:, 1]):.2f}"
    )


def _typical(scores: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Standard deviation of a normal distribution with the same median of its size."""
    return float(np.median(scores)) / 0.6745


def main() -> int:
    """Read a folder of sessions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="+", help="that random_rigs.py --keep filled")
    wanted = parser.parse_args()
    found, unfinished = {}, {}
    for path in sorted(path.parent for folder in wanted.folder for path in folder.glob("*/session.json")):
        try:
            found[path.name] = judgement(path)
        except RigError as error:
            unfinished[path.name] = str(error)
    print(table(found, unfinished))
    return 0


if __name__ == "__main__":
    sys.exit(main())
