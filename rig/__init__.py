"""Controller of projector-camera rigs: measure a scene, model its interreflection, compensate it, see what was gained.

Every verb of the command line is a function. A whole session is one call, or one call a stage:

>>> import tempfile
>>> import rig
>>> folder = tempfile.mkdtemp() + "/first"
>>> profile = rig.load_profile("ci-tiny")
>>> with rig.Session.open(folder, profile) as session, rig.open_rig(profile) as pair:
...     rig.calibrate(pair, session)
...     rig.separate(pair, session)
...     rig.model(session)
...     rig.compensate(session)
...     result = rig.compare(pair, session)
>>> result.measured.compensated.mean < 0.5 * result.measured.uncompensated.mean  # grey levels of 255
True
>>> rig.run_session(rig.SessionRequest(folder=folder)).comparison == result.comparison  # all is done already
True

What is done is kept in the session's folder, and skipped when it is asked for again. ``pair`` is a camera and a
projector: simulated, replayed or real, as the profile says. Errors are those of :mod:`rig.errors`; all are a
:class:`RigError`. What a session left on the disk is read with :meth:`Session.finished`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.benchmark import run_bench
    from rig.by_hand.look import look
    from rig.by_hand.show import show_picture
    from rig.capture.rig import Rig
    from rig.emulated.commands import run_emulated
    from rig.emulated.virtual import run_virtual
    from rig.errors import RigError
    from rig.inventory.list import list_devices
    from rig.lenses.run import run_lenses
    from rig.live.plan import LiveRequest, plan_live
    from rig.live.run import run_live
    from rig.notebook import NotebookProgress, session_pictures
    from rig.offline.scan import run_scan
    from rig.offline.simulate import SimulationRequest, run_simulate
    from rig.page.serve import ServeRequest, serve_page
    from rig.paper.experiments import run_paper
    from rig.plan.compute import plan_room
    from rig.plan.records import PlanResult
    from rig.plan.request import PlanRequest, load_room
    from rig.profile.schema import load_profile
    from rig.recheck.records import RecheckRequest
    from rig.recheck.run import run_recheck
    from rig.report.export import export_session
    from rig.run.plan import plan_session
    from rig.run.request import SessionRequest
    from rig.run.script import calibrate, compare, compensate, model, open_rig, separate, write_report
    from rig.run.session import run_session
    from rig.self_check import run_check
    from rig.session import Session
    from rig.stages.results import SessionResult
    from rig.strategies.comparison import Comparison, compare_strategies
    from rig.sweeps.run import sweep
    from rig.version import __version__

_HOMES = {
    "Comparison": "strategies.comparison",
    "LiveRequest": "live.plan",
    "NotebookProgress": "notebook",
    "PlanRequest": "plan.request",
    "PlanResult": "plan.records",
    "RecheckRequest": "recheck.records",
    "Rig": "capture.rig",
    "RigError": "errors",
    "ServeRequest": "page.serve",
    "Session": "session",
    "SessionRequest": "run.request",
    "SessionResult": "stages.results",
    "SimulationRequest": "offline.simulate",
    "__version__": "version",
    "calibrate": "run.script",
    "compare": "run.script",
    "compare_strategies": "strategies.comparison",
    "compensate": "run.script",
    "export_session": "report.export",
    "list_devices": "inventory.list",
    "load_profile": "profile.schema",
    "load_room": "plan.request",
    "look": "by_hand.look",
    "model": "run.script",
    "open_rig": "run.script",
    "plan_live": "live.plan",
    "plan_room": "plan.compute",
    "plan_session": "run.plan",
    "run_bench": "benchmark",
    "run_check": "self_check",
    "run_emulated": "emulated.commands",
    "run_virtual": "emulated.virtual",
    "run_lenses": "lenses.run",
    "run_live": "live.run",
    "run_paper": "paper.experiments",
    "run_recheck": "recheck.run",
    "run_scan": "offline.scan",
    "run_session": "run.session",
    "run_simulate": "offline.simulate",
    "separate": "run.script",
    "serve_page": "page.serve",
    "session_pictures": "notebook",
    "show_picture": "by_hand.show",
    "sweep": "sweeps.run",
    "write_report": "run.script",
}
"""Where each public name lives."""

__all__ = [
    "Comparison",
    "LiveRequest",
    "NotebookProgress",
    "PlanRequest",
    "PlanResult",
    "RecheckRequest",
    "Rig",
    "RigError",
    "ServeRequest",
    "Session",
    "SessionRequest",
    "SessionResult",
    "SimulationRequest",
    "__version__",
    "calibrate",
    "compare",
    "compare_strategies",
    "compensate",
    "export_session",
    "list_devices",
    "load_profile",
    "load_room",
    "look",
    "model",
    "open_rig",
    "plan_live",
    "plan_room",
    "plan_session",
    "run_bench",
    "run_check",
    "run_emulated",
    "run_lenses",
    "run_live",
    "run_paper",
    "run_recheck",
    "run_scan",
    "run_session",
    "run_simulate",
    "run_virtual",
    "separate",
    "serve_page",
    "session_pictures",
    "show_picture",
    "sweep",
    "write_report",
]


def __dir__() -> list[str]:
    return __all__


if not TYPE_CHECKING:
    # Each name is imported when it is first used: `rig --help` needs no numpy, and Ctrl-C meets a quiet import.
    def __getattr__(name):
        if name not in _HOMES:
            raise AttributeError(f"module 'rig' has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(f"rig.{_HOMES[name]}"), name)
