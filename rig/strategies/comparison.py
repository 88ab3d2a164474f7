"""Every strategy beside the others, measured on the rig: `rig compare-strategies SESSION`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Rig
from rig.errors import SessionError
from rig.files.channels import code_layers, codes_of, layers
from rig.run import script as verbs
from rig.run.session import Request, opened_session, target_of
from rig.session import Session, Step
from rig.session.ledger import write_json
from rig.stages.compensation import check_strategies, predict
from rig.stages.linear_light import merge_exposures
from rig.stages.model import load_model
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.radiometry import measuring_bracket
from rig.strategies.closed_loop import ControlledScene, Loop, close_loop, controlled_scene_of
from rig.strategies.pictures import Picture, pictures_for
from rig.terminal import OnStep
from sim.compensation import STRATEGIES, Compensation, compensate

FloatArray = NDArray[np.float64]

AFTER = (1, 2, 4, 8)
"""Numbers of captures after which a closed loop's error is told."""
RECORD = "strategies"


@dataclass(frozen=True, slots=True)
class Comparison:
    """What is to be compared."""

    request: Request
    """Its strategies are those that are projected; none: all that there are."""
    loops: tuple[str, ...] = ("bounded",)
    """Strategies whose loop is closed."""
    captures: int = 4
    rule: str = "image"
    perfect: bool = False
    """Also what perfect knowledge of the simulated world would give, for the strategies in ``loops``."""
    test_pictures: bool = True
    """Also the two-wall picture, the dark and the bright photograph."""


def compare_strategies(wanted: Comparison, on_step: OnStep) -> dict[str, Any]:
    """Project, photograph and judge every strategy; does first what the session lacks up to its model.

    Returns
    -------
    dict
        ``session profile target noise_rms``; ``pictures``: for each its ``name title rows``, a row a strategy with
        ``strategy predicted measured`` (errors), ``contrast clipped_share gain seconds iterations captures frames
        notes``; ``loops``: for each closed loop its ``strategy rule damping best stopped after`` (errors by captures);
        ``perfect``: rows like the others; ``ratios``; ``warnings``; ``report``; ``elapsed_s``.

    Raises
    ------
    UsageError, ProfileError, DeviceError, SessionError, CalibrationFailed
        As `rig run`. The session keeps the answer as strategies.json.
    """
    started_s = time.perf_counter()
    names = check_strategies(wanted.request.strategies or tuple(STRATEGIES))
    loops = [Loop(name, wanted.captures, wanted.rule).checked() for name in wanted.loops]
    target = target_of(wanted.request)
    with opened_session(wanted.request) as (rig, session):
        verbs.calibrate(rig, session, on_step)
        verbs.separate(rig, session, on_step)
        verbs.model(rig, session, on_step)
        pictures = pictures_for(load_model(session), target)[: None if wanted.test_pictures else 1]
        compared = [_compare_picture(rig, session, picture, names, on_step) for picture in pictures]
        closed = [close_loop(rig, session, target, loop, on_step) for loop in loops]
        known = oracle_rows(rig, session, pictures[0], wanted.loops, on_step) if wanted.perfect else []
        result = _result(session, compared, closed, known)
        result["report"] = str(_report(session, result, on_step))
        write_json(session.path / "strategies.json", result)
    return {**result, "elapsed_s": time.perf_counter() - started_s}


def _report(session: Session, result: Mapping[str, Any], on_step: OnStep) -> Any:
    from rig.strategies.page import write_strategies_page

    return write_strategies_page(session, result, on_step)


def _compare_picture(
    rig: Rig, session: Session, picture: Picture, names: Sequence[str], on_step: OnStep
) -> dict[str, Any]:
    """Step `strategies-PICTURE`: each strategy's picture computed, photographed and judged."""
    shot = measuring_bracket(rig, session)
    step = picture_step(session, f"strategies-{picture.name}", picture, names, shot)
    if not step.done:
        plant = controlled_scene_of(session, step, picture.target)
        computed = {}
        for k, name in enumerate(names):
            on_step(f"compute strategies: {picture.name}", k, len(names))
            solution = plant.solved(name, plant.wanted)
            computed[name] = keep_solution(step, plant, picture, name, solution, seed=k + 1)
        on_step(f"compute strategies: {picture.name}", len(names), len(names))
        rows = photographed_rows(rig, session, step, plant, picture, computed, shot, on_step)
        step.save_record(step.name, {"name": picture.name, "title": picture.target.name, "rows": rows})
        step.finish()
    return step.load_record(step.name)


def picture_step(session: Session, name: str, picture: Picture, names: Sequence[str], shot: ExposureBracket) -> Step:
    """A step for pictures of strategies for one target, which it keeps as its image ``target``."""
    settings = {
        "target_sha256": picture.target.sha256,
        "strategies": list(names),
        "exposures_s": shot.exposures_s,
        "repeats": shot.repeats,
    }
    step = session.step(name, settings=settings, needs=("response", "model"))
    if not step.done:
        step.save_image("target", layers("grey", picture.target.levels))
    return step


def keep_solution(
    step: Step, plant: ControlledScene, picture: Picture, name: str, solution: Compensation, seed: int
) -> dict[str, Any]:
    """Save the codes of a strategy and what the model predicts of them; what is known of it before it is shown."""
    codes = plant.codes(solution.projector_image, seed)
    predicted = predict(plant.model, plant.radiometric.projector, codes)
    step.save_image(f"projector-{picture.name}-{name}", code_layers(codes))
    step.save_image(f"predicted-{picture.name}-{name}", layers("light", predicted))
    return {
        "predicted": plant.judged(predicted),
        "clipped_share": float(solution.clipped.mean()),
        "gain": float(solution.notes.get("gain", 1.0)),
        "seconds": solution.seconds,
        "iterations": solution.iterations,
        "notes": dict(solution.notes),
    }


def photographed_rows(
    rig: Rig,
    session: Session,
    step: Step,
    plant: ControlledScene,
    picture: Picture,
    computed: Mapping[str, Mapping[str, Any]],
    shot: ExposureBracket,
    on_step: OnStep,
) -> list[dict[str, Any]]:
    """Show and photograph what was computed, and judge it."""
    patterns = {
        name: Pattern(f"{step.name}-{name}", codes_of(step.load_image(f"projector-{picture.name}-{name}")))
        for name in computed
    }
    photograph(rig, session, step, patterns.values(), shot, len(patterns), on_step)
    rows = []
    for k, (name, known) in enumerate(computed.items()):
        on_step(f"judge strategies: {picture.name}", k, len(computed))
        light = merge_exposures(step, patterns[name].name, shot, plant.radiometric)
        step.save_image(f"measured-{picture.name}-{name}", light.channels)
        measured = {"measured": plant.judged_light(light), "captures": 1, "frames": shot.frames_per_pattern}
        rows.append({"strategy": name, **known, **measured})
    on_step(f"judge strategies: {picture.name}", len(computed), len(computed))
    return rows


def oracle_rows(
    rig: Rig, session: Session, picture: Picture, names: Sequence[str], on_step: OnStep
) -> list[dict[str, Any]]:
    """Step `perfect`: strategies with the true light transport of the simulated world, photographed like all others.

    Raises SessionError on a rig whose truth nobody knows.
    """
    from rig.truth.scores import ground_truth_worlds
    from rig.truth.transport import ground_truth_transport

    if rig.profile.simulation is None:
        raise SessionError(f"{session.path}: only a simulated rig knows its truth; leave --perfect out")
    shot = measuring_bracket(rig, session)
    step = picture_step(session, "perfect", picture, names, shot)
    if not step.done:
        plant = controlled_scene_of(session, step, picture.target)
        on_step("perfect knowledge", 0, len(names) + 1)
        transport = ground_truth_transport(ground_truth_worlds(rig), plant.model)
        computed = {}
        for k, name in enumerate(names):
            on_step("perfect knowledge", k + 1, len(names) + 1)
            solution = compensate(name, transport, plant.wanted)
            computed[name] = keep_solution(step, plant, picture, name, solution, seed=k + 1)
        on_step("perfect knowledge", len(names) + 1, len(names) + 1)
        rows = photographed_rows(rig, session, step, plant, picture, computed, shot, on_step)
        step.save_record("perfect", {"rows": rows})
        step.finish()
    found: list[dict[str, Any]] = step.load_record("perfect")["rows"]
    return found


def _result(
    session: Session,
    compared: list[dict[str, Any]],
    closed: list[dict[str, Any]],
    known: list[dict[str, Any]],
) -> dict[str, Any]:
    rows = {row["strategy"]: row for row in compared[0]["rows"]}
    loops = [{**loop, "after": _after(loop["captures"])} for loop in closed]
    return {
        "session": str(session.path),
        "profile": session.profile.name,
        "target": compared[0]["title"],
        "noise_rms": rows["none"]["measured"]["noise_rms"],
        "pictures": compared,
        "loops": loops,
        "perfect": known,
        "ratios": ratios(rows, loops, known),
        "warnings": warnings_of(compared),
    }


def _after(captures: Sequence[Mapping[str, float]]) -> dict[str, Mapping[str, float]]:
    """The best picture's errors after 1, 2, 4, 8 captures, and after all; where it stopped before, the last."""
    numbers = sorted({number for number in AFTER if number <= len(captures)} | {len(captures)})
    return {str(number): min(captures[:number], key=lambda errors: errors["mean"]) for number in numbers}


def ratios(
    rows: Mapping[str, Mapping[str, Any]], loops: Sequence[Mapping[str, Any]], known: Sequence[Mapping[str, Any]]
) -> dict[str, float]:
    """Measured mean errors over the uncompensated picture's, and over what perfect knowledge gives."""
    means = {name: row["measured"]["mean"] for name, row in rows.items()}
    means |= {f"{loop['strategy']}, closed loop": loop["captures"][loop["best"] - 1]["mean"] for loop in loops}
    found = {f"{name} / none": mean / means["none"] for name, mean in means.items() if name != "none"}
    for row in known:
        for name in (row["strategy"], f"{row['strategy']}, closed loop"):
            if name in means:
                found[f"{name} / perfect knowledge"] = means[name] / row["measured"]["mean"]
    return found


def warnings_of(compared: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence for each strategy whose error is above that of direct light alone, clamped; measured if it was."""
    found = []
    for picture in compared:
        means = {row["strategy"]: (row.get("measured") or row["predicted"])["mean"] for row in picture["rows"]}
        limit = means.get("direct")
        found += [
            f"{picture['name']}: '{name}' shows a mean error of {mean:.1f}, 'direct' clamped one of {limit:.1f}"
            for name, mean in means.items()
            if limit is not None and mean > limit
        ]
    return found
