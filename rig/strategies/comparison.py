"""Every strategy beside the others, measured on the rig: `rig compare-strategies SESSION`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.patterns import Pattern
from rig.errors import SessionError
from rig.files.channels import code_layers, codes_of, layers
from rig.profile.schema import Profile
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.run.session import OpenSession, opened_session
from rig.run.steps import required
from rig.session import Session, Step
from rig.session.alignment import aligned_folder
from rig.session.ledger import write_json
from rig.stages.compensation import dither_seed, solve, versions_of
from rig.stages.linear_light import merge_exposures
from rig.stages.model import load_model
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.prediction import JUDGED, predict
from rig.stages.radiometry import measuring_bracket
from rig.stages.showing.dark import dark_settings
from rig.stages.showing.place import placed
from rig.stages.target import check_strategies
from rig.stages.transport.earlier import gather_evidence
from rig.stages.transport.evidence import model_steps
from rig.strategies.closed_loop import ControlledScene, Loop, close_loop, controlled_scene_of
from rig.strategies.page import write_strategies_page
from rig.strategies.pictures import ComparisonPicture, pictures_for
from rig.strategies.records import ClosedLoop, ComparedPicture, ComparisonResult, OracleRows, StrategyRow
from rig.terminal import OnStep, silent
from sim.compensation import Compensation

FloatArray = NDArray[np.float64]

RECORD = "strategies"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """What is to be compared."""

    request: SessionRequest
    """Its strategies are those that are projected; none: all that there are."""
    loops: tuple[str, ...] = ("bounded",)
    """Strategies whose loop is closed."""
    captures: int = 4
    rule: str = "image"
    oracle: bool = False
    """Also what knowing the simulated world would give, for the strategies in ``loops``."""
    test_pictures: bool = True
    """Also the two-wall picture, the dark and the bright photograph."""


def compare_strategies(wanted: Comparison, on_step: OnStep = silent) -> ComparisonResult:
    """Project, photograph and judge every strategy; does first what the session lacks up to its model.

    Parameters
    ----------
    wanted
        What is to be compared.
    on_step
        Told how far it is: what is being done, how many parts are done, of how many.

    Returns
    -------
    ComparisonResult
        Errors in grey levels of 255.

    Raises
    ------
    UsageError, ProfileError, DeviceError, SessionError, CalibrationFailed
        As `rig run`. The session keeps the answer as strategies.json.
    """
    started_s = time.perf_counter()
    names = check_strategies(wanted.request.strategies or ("all",))
    loops = [Loop(name, wanted.captures, wanted.rule).checked() for name in wanted.loops]
    plan = plan_session(replace(wanted.request, folder=aligned_folder(Path(wanted.request.folder))))
    target = required(plan.showing).target
    if wanted.oracle:
        refuse_unknown_world(plan.profile, plan.folder)
    with opened_session(plan) as work:
        session = work.session
        work.do_up_to("model", on_step)
        gather_evidence(session, target, on_step)
        target = placed(load_model(session), target)
        pictures = pictures_for(load_model(session), target)[: None if wanted.test_pictures else 1]
        compared = tuple(_compare_picture(work, picture, names=names, on_step=on_step) for picture in pictures)
        closed = tuple(close_loop(work, target, loop=loop, on_step=on_step) for loop in loops)
        known = oracle_rows(work, pictures[0], names=wanted.loops, on_step=on_step) if wanted.oracle else ()
        result = _result(session, compared, closed, known)
        result = replace(result, report=str(write_strategies_page(session, result, on_step)))
        write_json(session.path / "strategies.json", result.as_json())
    return replace(result, elapsed_s=time.perf_counter() - started_s)


def _compare_picture(
    work: OpenSession, picture: ComparisonPicture, names: Sequence[str], on_step: OnStep
) -> ComparedPicture:
    """Step `strategies-PICTURE`: each strategy's picture computed, photographed and judged."""
    session = work.session
    shot = measuring_bracket(session)
    step = picture_step(session, f"strategies-{picture.name}", picture, names=names, shot=shot)
    if not step.done:
        room = controlled_scene_of(session, step, picture.target)
        computed = {}
        for k, name in enumerate(names):
            on_step(f"compute strategies: {picture.name}", k, len(names))
            solution = room.solved(name, room.wanted)
            computed[name] = keep_solution(step, room, picture, name=name, solution=solution, seed=dither_seed(name))
        on_step(f"compute strategies: {picture.name}", len(names), len(names))
        rows = photographed_rows(work, step, room=room, picture=picture, computed=computed, shot=shot, on_step=on_step)
        record = ComparedPicture(name=picture.name, title=picture.target.name, rows=rows, target=picture.target.shown)
        step.save_record(step.name, record)
        step.finish()
    return step.load_record(step.name, ComparedPicture)


def picture_step(
    session: Session, name: str, picture: ComparisonPicture, names: Sequence[str], shot: ExposureBracket
) -> Step:
    """A step for pictures of strategies for one target, which it keeps as its image ``target``."""
    settings = {
        "target_sha256": picture.target.sha256,
        "judged": JUDGED,
        "versions": versions_of(names),
        "exposures_s": shot.exposures_s,
        "repeats": shot.repeats,
        **dark_settings(session.profile),
    }
    step = session.step(name, settings=settings, needs=("response", *model_steps(session)))
    if not step.done:
        step.save_image("target", layers("grey", picture.target.levels))
    return step


def keep_solution(
    step: Step, room: ControlledScene, picture: ComparisonPicture, name: str, solution: Compensation, seed: int
) -> StrategyRow:
    """Save the codes of a strategy and what the model predicts of them; what is known of it before it is shown."""
    codes = room.codes(solution.projector_image, seed)
    predicted = predict(room.model, room.radiometric, codes)
    step.save_image(f"projector-{picture.name}-{name}", code_layers(codes))
    step.save_image(f"predicted-{picture.name}-{name}", predicted.channels)
    return StrategyRow(
        strategy=name,
        predicted=room.judged(predicted.light),
        clipped_share=float(solution.clipped.mean()),
        gain=float(solution.notes.get("gain", 1.0)),
        seconds=solution.seconds,
        iterations=solution.iterations,
        notes=dict(solution.notes),
    )


def photographed_rows(
    work: OpenSession,
    step: Step,
    room: ControlledScene,
    picture: ComparisonPicture,
    computed: Mapping[str, StrategyRow],
    shot: ExposureBracket,
    on_step: OnStep,
) -> tuple[StrategyRow, ...]:
    """Show and photograph what was computed, and judge it."""
    patterns = {
        name: Pattern(f"{step.name}-{name}", codes_of(step.load_image(f"projector-{picture.name}-{name}")))
        for name in computed
    }
    photograph(
        work.rig(),
        work.session,
        step,
        patterns.values(),
        bracket=shot,
        n_patterns=len(patterns),
        on_step=on_step,
    )
    rows = []
    for k, (name, known) in enumerate(computed.items()):
        on_step(f"judge strategies: {picture.name}", k, len(computed))
        light = merge_exposures(step, patterns[name].name, shot, room.radiometric)
        step.save_image(f"measured-{picture.name}-{name}", light.channels)
        measured = room.judged_light(light)
        rows.append(replace(known, measured=measured, captures=1, frames=shot.frames_per_pattern))
    on_step(f"judge strategies: {picture.name}", len(computed), len(computed))
    return tuple(rows)


def refuse_unknown_world(profile: Profile, folder: Path) -> None:
    """Refuse an oracle where there is none, before anything is photographed for it.

    Raises
    ------
    SessionError
        The rig is real, or its simulated world is no box.
    """
    if profile.simulation is None:
        raise SessionError(f"{folder}: only a simulated rig knows its truth; leave --oracle out")
    if profile.simulation.scene is not None:
        raise SessionError(
            f"{folder}: simulation.scene: what knowing the world would give is there for boxes only; leave --oracle out"
        )


def oracle_rows(
    work: OpenSession, picture: ComparisonPicture, names: Sequence[str], on_step: OnStep
) -> tuple[StrategyRow, ...]:
    """Step `oracle`: strategies with the true light transport of the simulated world, photographed like all others."""
    from rig.truth.scores import ground_truth_worlds
    from rig.truth.transport import ground_truth_transport

    session = work.session
    shot = measuring_bracket(session)
    step = picture_step(session, "oracle", picture, names=names, shot=shot)
    if not step.done:
        room = controlled_scene_of(session, step, picture.target)
        on_step("knowing the simulated world", 0, len(names) + 1)
        transport = ground_truth_transport(ground_truth_worlds(work.rig()), room.model)
        computed = {}
        for k, name in enumerate(names):
            on_step("knowing the simulated world", k + 1, len(names) + 1)
            solution = solve(name, transport, room.wanted)
            computed[name] = keep_solution(step, room, picture, name=name, solution=solution, seed=dither_seed(name))
        on_step("knowing the simulated world", len(names) + 1, len(names) + 1)
        rows = photographed_rows(work, step, room=room, picture=picture, computed=computed, shot=shot, on_step=on_step)
        step.save_record("oracle", OracleRows(rows=rows))
        step.finish()
    return step.load_record("oracle", OracleRows).rows


def _result(
    session: Session,
    compared: tuple[ComparedPicture, ...],
    closed: tuple[ClosedLoop, ...],
    known: tuple[StrategyRow, ...],
) -> ComparisonResult:
    uncompensated = compared[0].row("none").shown
    return ComparisonResult(
        session=str(session.path),
        profile=session.profile.name,
        target=compared[0].title,
        noise_rms=uncompensated.noise_rms,
        pictures=compared,
        loops=closed,
        oracle=known,
        ratios=ratios(compared[0].rows, closed, known),
        warnings=warnings_of(compared),
    )


def ratios(rows: Sequence[StrategyRow], loops: Sequence[ClosedLoop], known: Sequence[StrategyRow]) -> dict[str, float]:
    """Measured mean errors over the uncompensated picture's, and over what knowing the simulated world gives."""
    means = {row.strategy: row.shown.mean for row in rows}
    means |= {f"{loop.strategy}, closed loop": loop.kept.mean for loop in loops}
    found = {f"{name} / none": mean / means["none"] for name, mean in means.items() if name != "none"}
    for row in known:
        for name in (row.strategy, f"{row.strategy}, closed loop"):
            if name in means:
                found[f"{name} / oracle"] = means[name] / row.shown.mean
    return found


def warnings_of(compared: Sequence[ComparedPicture]) -> tuple[str, ...]:
    """A sentence for each strategy whose error is above that of direct light alone, clamped; measured if it was."""
    return tuple(text for picture in compared for text in _worse_than_direct(picture))


def _worse_than_direct(picture: ComparedPicture) -> Iterator[str]:
    means = {row.strategy: row.shown.mean for row in picture.rows}
    limit = means.get("direct")
    for name, mean in means.items():
        if limit is not None and mean > limit:
            yield f"{picture.name}: '{name}' shows a mean error of {mean:.1f}, 'direct' clamped one of {limit:.1f}"
