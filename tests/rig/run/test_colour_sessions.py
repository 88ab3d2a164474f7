"""A whole session in colour: a red and a green wall, a projector whose channels mix, a camera of three channels."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.capture.rig import open_rig
from rig.devices.simulated.rigs import simulated_world_of, simulated_worlds_of
from rig.errors import CalibrationFailed, ProfileError
from rig.files.channels import image_of
from rig.files.pictures import write_png
from rig.live.model import black_at_pixels, session_model
from rig.profile.schema import load_profile
from rig.run import script as verbs
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.run.session import run_part, run_session
from rig.session import Session
from rig.stages.linear_light import channel_codes, channel_light
from rig.stages.model import FittedScene, load_model
from rig.stages.prediction import wanted_light, whole_picture
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.results import SessionResult
from rig.stages.target import Target, load_target
from rig.strategies.closed_loop import CapturedLight, Loop, controlled_scene_of, corrected
from rig.terminal import silent
from rig.truth.scores import ground_truth_worlds
from rig.truth.transport import ground_truth_transport
from sim.compensation import compensate
from sim.frame.compensator import FrameCompensator
from sim.light.colour import ColourTransport

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
FloatArray = NDArray[np.float64]
MIXING = np.array([[0.91, 0.07, 0.02], [0.06, 0.92, 0.08], [0.02, 0.07, 0.84]])
COLOURED = {
    "channels = 1": "channels = 3",
    'name = "ci-tiny"': 'name = "ci-colour"',
    "x1 = 0.71": "x1 = [0.74, 0.36, 0.30]",
    "y1 = 0.68": "y1 = [0.34, 0.66, 0.38]",
    "reflectance = 0.45": "reflectance = [0.35, 0.42, 0.62]",
    "gamma = 2.2": "gamma = [2.4, 2.2, 2.0]",
}


def profile_file(folder: Path, mixing: FloatArray = MIXING, more: str = "", **changes: str) -> Path:
    """The tiny rig in colour."""
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text("utf-8")
    for old, new in {**COLOURED, **changes}.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "ci-colour.toml"
    path.write_text(f"{text}mixing = {mixing.tolist()}\n{more}", "utf-8")
    return path


@dataclass(frozen=True)
class Coloured:
    """A finished session in colour, and what it has measured; tests only read it."""

    folder: Path
    profile: Path
    metrics: SessionResult

    def model(self) -> FittedScene:
        with Session.open(self.folder) as session:
            return load_model(session)


@pytest.fixture(scope="module")
def coloured(tmp_path_factory: pytest.TempPathFactory) -> Coloured:
    folder = tmp_path_factory.mktemp("coloured")
    profile = profile_file(folder)
    metrics = run_session(SessionRequest(folder=folder / "session", profile=profile), silent)
    return Coloured(folder / "session", profile, metrics)


# What is measured


def test_how_the_projectors_channels_mix_is_found(coloured: Coloured) -> None:
    found, shares = coloured.metrics.model, MIXING / MIXING.sum(axis=1, keepdims=True)
    assert np.array(found.mixing) == pytest.approx(shares, abs=2e-3)
    assert coloured.metrics.truth.mixing_max_error < 2e-3
    assert found.mixing_variation < 0.01
    assert found.white_over_channels == pytest.approx([1, 1, 1], abs=0.005)


def test_each_wall_has_its_own_colour(coloured: Coloured) -> None:
    """Means over the lit patches of each wall; the poster on the red one is a patch or two."""
    model = coloured.model()
    for name, colour in {"x1": (0.74, 0.36, 0.30), "y1": (0.34, 0.66, 0.38), "floor": (0.66,) * 3}.items():
        face = next(face for face in model.scene_model.scene.faces if face.name == name)
        found = [float(np.median(scene_model.scene.reflectance[face.patches])) for scene_model in model.room.bands]
        assert found == pytest.approx(colour, abs=0.04), name
    assert coloured.metrics.truth.reflectance_rmse_lit_and_seen < 0.03


def test_each_channel_has_its_own_response_out_of_grey_pictures(coloured: Coloured) -> None:
    with Session.open(coloured.folder) as session:
        radiometric = load_radiometric_calibration(session)
        names = [name for name in session.finished("response").frame_names if name.startswith(("red", "green", "blue"))]
    code = np.array([64, 128, 192])
    x = code / 255
    for response, gamma in zip(radiometric.projector, (2.4, 2.2, 2.0), strict=True):
        true = 0.75 * x**gamma + 0.25 * x * x * (3 - 2 * x)
        assert np.interp(code, response.levels, response.linear) == pytest.approx(true, abs=2e-3)
    assert len(names) == 6, "three more pictures at each of two exposures"


def test_white_is_balanced_between_the_bands(coloured: Coloured) -> None:
    model = coloured.model()
    medians = [np.median(model.white[..., b][model.lit]) for b in range(3)]
    assert medians == pytest.approx([medians[0]] * 3, rel=0.05)
    assert model.level == pytest.approx(0.7 * np.mean(medians))


# What is done with it


def test_compensation_takes_most_of_the_error_away(coloured: Coloured) -> None:
    measured = coloured.metrics.measured
    assert measured.compensated.mean <= 0.3 * measured.uncompensated.mean
    assert coloured.metrics.within_limits


def test_every_frame_is_predicted_in_every_band(coloured: Coloured) -> None:
    with Session.open(coloured.folder) as session:
        model = load_model(session)
        compared, compensated = session.finished("compare"), session.finished("compensate")
        measured = image_of(compared.load_image("measured-bounded"), "light")
        predicted = image_of(compensated.load_image("predicted-bounded"), "light")
        mask = compared.load_image("judged")["mask"] > 0
    difference = (measured - predicted)[mask] * 255 / model.level
    assert np.sqrt((difference**2).mean(axis=0)).max() < 6
    assert np.abs(difference.mean(axis=0)).max() < 2


def test_bleeding_colours_are_compensated_better_than_by_a_grey_model_of_the_room(coloured: Coloured) -> None:
    """Both pictures in the world's own light; the grey model has the green band's room for all, and no mixing."""
    model = coloured.model()
    with open_rig(load_profile(coloured.profile)) as rig:
        truth = ground_truth_transport(ground_truth_worlds(rig), model)
    bands = model.room.projector_transport.bands
    grey = ColourTransport([bands[1]] * 3, np.eye(3))
    wanted = wanted_light(model, load_target(None, model.scene_model.projector.lens.shape, channels=3))
    errors = {}
    for name, known in (("colour", model.room.projector_transport), ("grey", grey)):
        shown = compensate("bounded", known, wanted).projector_image
        errors[name] = float(np.abs(truth.forward(shown) - wanted).mean()) * 255 / model.level
    assert errors["colour"] < 0.4 * errors["grey"]


def test_live_pictures_use_what_the_session_knows_of_colour(coloured: Coloured) -> None:
    with Session.open(coloured.folder) as session:
        live = session_model(session, is_linear=True)
        step = session.finished("compensate")
        target = np.rint(image_of(step.load_image("target"), "grey")).astype(np.uint8)
        wanted = image_of(step.load_image("projector-exact"), "codes")
    assert live.notes == ()
    assert live.frames.mixing == pytest.approx(MIXING / MIXING.sum(axis=1, keepdims=True), abs=2e-3)
    assert live.frames.response.shape == (3, 256)
    assert (live.frames.black_emission.mean(axis=1) > 0).all()
    codes = FrameCompensator(live.frames, "exact").frame(target)
    difference = np.abs(codes.astype(float) - wanted)[live.frames.active]
    assert (np.median(difference, axis=0) <= 2).all()
    assert difference.mean() < 5


def test_a_live_picture_comes_as_near_to_its_target_as_the_sessions_own(coloured: Coloured) -> None:
    """In the simulated world's own light, black included: live pictures leave room for it."""
    model = coloured.model()
    with open_rig(load_profile(coloured.profile)) as rig:
        truth = ground_truth_transport(ground_truth_worlds(rig), model)
    with Session.open(coloured.folder) as session:
        live, radiometric = session_model(session, is_linear=True), load_radiometric_calibration(session)
    target = Target(
        name="whole levels",
        levels=np.rint(load_target(None, model.scene_model.projector.lens.shape, channels=3).levels),
    )
    wanted = wanted_light(model, target)
    live_codes = FrameCompensator(live.frames, "bounded").frame(target.levels.astype(np.uint8))
    own = compensate("bounded", model.room.projector_transport, wanted).projector_image
    own_codes = channel_codes(radiometric.projector, whole_picture(model, own), seed=1)
    black = black_at_pixels(model, radiometric)
    errors = []
    for codes, unavoidable in ((live_codes, black), (own_codes, 0.0)):
        light = channel_light(radiometric.projector, codes).reshape(-1, 3)[model.room.active].astype(np.float64)
        errors.append(float(np.abs(truth.forward(light) + unavoidable - wanted).mean()))
    assert errors[0] < 1.1 * errors[1]


def test_a_band_that_is_too_dark_gets_its_light_from_all_channels(coloured: Coloured) -> None:
    """The correction undoes the mixing: direct light changes in that band alone."""
    with Session.open(coloured.folder) as session:
        room = controlled_scene_of(session, session.finished("compensate"), load_target(None, (192, 256), channels=3))
    image = np.full_like(room.wanted, 0.5)
    error = np.array([0.0, 0.02, 0.0]) * room.operator.diagonal
    seen = CapturedLight(image, room.model.room.through_camera(room.wanted) - error, np.full_like(image, 1e-12))
    change = corrected(room, Loop("bounded", 2, "image"), image, seen) - image
    assert (np.abs(change).mean(axis=0) > 1e-4).all()
    assert change @ room.transport.mixing.T == pytest.approx(
        np.broadcast_to([0.0, 0.02 * room.damping, 0.0], change.shape), abs=1e-9
    )


# How it goes


def test_a_session_that_was_stopped_gives_the_same_numbers(coloured: Coloured, tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    def stop_in_the_colours(label: str, done: int, total: int) -> None:
        # The last six of all frames are those of the colours.
        if label == "photograph: response" and done == total - 3:
            raise Stopped

    request = SessionRequest(folder=tmp_path / "session", profile=coloured.profile)
    with pytest.raises(Stopped):
        run_session(request, stop_in_the_colours)
    assert run_part(request, "separate", silent).separation == coloured.metrics.separation
    ours, theirs = (
        json.loads((folder / "calibration" / "radiometric-001.json").read_text("utf-8"))
        for folder in (Path(request.folder), coloured.folder)
    )
    assert ours == theirs


def test_the_plan_counts_the_three_more_pictures(coloured: Coloured, tmp_path: Path) -> None:
    frames = [
        {
            step.step: step.frames
            for step in plan_session(SessionRequest(folder=tmp_path / "new", profile=profile)).steps
        }
        for profile in (coloured.profile, "ci-tiny")
    ]
    assert frames[0].pop("response") == frames[1].pop("response") + 6
    assert frames[0] == frames[1]


# What is asked of the target


def test_a_coloured_target_keeps_its_colours_and_a_grey_one_is_grey_in_all(tmp_path: Path) -> None:
    rgb = np.random.default_rng(1).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    write_png(tmp_path / "colour.png", rgb)
    write_png(tmp_path / "grey.png", rgb[..., 0])
    assert np.array_equal(load_target(tmp_path / "colour.png", (6, 8), channels=3, is_linear=True).levels, rgb)
    assert np.array_equal(
        load_target(tmp_path / "grey.png", (6, 8), channels=3, is_linear=True).levels, rgb[..., :1].repeat(3, axis=2)
    )


def test_the_default_target_is_a_colour_photograph() -> None:
    target: Target = load_target(None, (96, 128), channels=3)
    assert target.levels.shape == (96, 128, 3)
    assert target.levels.mean() == pytest.approx(123, abs=0.1)
    assert target.levels.std() == pytest.approx(46, abs=0.1)
    assert np.abs(target.levels[..., 0] - target.levels[..., 2]).mean() > 10


# What is refused


def calibrated(profile: Path, folder: Path) -> None:
    with open_rig(load_profile(profile)) as rig, Session.open(folder, rig.profile) as session:
        verbs.calibrate(rig, session)


def test_a_white_segment_is_refused_by_its_brightness(tmp_path: Path) -> None:
    profile = profile_file(tmp_path, more="white_boost = 0.25\n", **{"cell_size_m = 0.2": "cell_size_m = 0.6"})
    with pytest.raises(
        CalibrationFailed, match=r"white is 1.2[45]., .* times red \+ green \+ blue.*another picture mode"
    ):
        calibrated(profile, tmp_path / "session")


def test_a_camera_that_sees_no_colours_is_refused(tmp_path: Path) -> None:
    alike = np.array([[0.33, 0.34, 0.33], [0.33, 0.33, 0.34], [0.34, 0.33, 0.33]])
    profile = profile_file(tmp_path, mixing=alike, **{"cell_size_m = 0.2": "cell_size_m = 0.6"})
    with pytest.raises(CalibrationFailed, match="two channels of the projector look alike to the camera"):
        calibrated(profile, tmp_path / "session")


# The simulated world


def test_a_grey_camera_sees_the_mean_of_the_walls_colours_and_of_the_projectors(tmp_path: Path) -> None:
    profile = load_profile(profile_file(tmp_path, **{"cell_size_m = 0.2": "cell_size_m = 0.6"}))
    grey, bands = simulated_world_of(profile), simulated_worlds_of(profile)
    assert grey.room.reflectance == pytest.approx(np.mean([band.room.reflectance for band in bands], axis=0), abs=1e-6)
    assert grey.channel_weights == pytest.approx(MIXING.mean(axis=0))
    red = np.zeros((*profile.projector.shape, 3), np.uint8)
    red[..., 0] = 255
    light = [float(world.projector_linear(red).mean()) for world in bands]
    assert light == pytest.approx(MIXING[:, 0], abs=2e-3), "and a little of what black lets through"


@pytest.mark.parametrize("wrong", ["[0.5, 0.5]", "[0.5, 0.5, 1.5]", "-0.1", '"red"'])
def test_a_reflectance_is_one_number_or_three_below_one(tmp_path: Path, wrong: str) -> None:
    with pytest.raises(ProfileError, match=r"simulation\.reflectance\.x1"):
        load_profile(profile_file(tmp_path, **{"x1 = 0.71": f"x1 = {wrong}"}))
