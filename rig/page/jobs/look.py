"""The job of looking: the camera's frames as small pictures with figures, while orders change picture and exposure."""

from __future__ import annotations

from rig.by_hand.preview import Preview, PreviewSettings, Region
from rig.errors import RigError, UsageError
from rig.page.jobs.requests import LookJob
from rig.page.jobs.wire import Wire
from rig.profile.schema import load_runnable_profile
from rig.records import Json, JsonObject
from rig.stages.error_tree import one_error_tree


def look_on(job: LookJob, wire: Wire) -> JsonObject:
    """Look until it is told to stop; returns how many frames there were."""
    profile = load_runnable_profile(job.profile)
    wire.tell("progress", {"label": "open the rig", "done": 0, "total": 1})
    settings = PreviewSettings(picture=job.picture, exposure_s=job.exposure_s)
    with one_error_tree(), Preview(profile, settings) as preview:
        wire.tell("progress", {"label": "look", "done": 0, "total": 0})
        wire.tell("state", preview.state.as_json())
        told = len(preview.events)
        while not wire.is_stopping:
            for order in wire.orders():
                _obey(order, preview, wire)
            seen = preview.next_frame()
            pieces = (seen.jpeg, seen.overlay) if seen.overlay else (seen.jpeg,)
            wire.tell("frame", seen.facts.as_json(), *pieces)
            for event in preview.events[told:]:
                wire.tell("fault", {"kind": event.kind, "detail": event.detail})
            told = len(preview.events)
        return {"frames": preview.frames}


def _obey(order: JsonObject, preview: Preview, wire: Wire) -> None:
    """Do what a page asks; what cannot be is told, and the view goes on."""
    try:
        match order.get("do"):
            case "picture":
                preview.show(str(order.get("picture", "")))
            case "exposure":
                preview.expose(_number(order.get("exposure_s")))
            case "gain":
                preview.amplify(_number(order.get("value")))
            case "region":
                preview.region = _region(order)
            case "watched":
                preview.is_watched = bool(order.get("on"))
            case other:
                raise UsageError(f"a view does not know the word {str(other)[:40]!r}; load the page anew")
    except RigError as error:
        wire.tell("refused", {"error": str(error)})
    wire.tell("state", preview.state.as_json())


def _number(value: Json) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"{str(value)[:40]!r} is no number; give digits")
    return float(value)


def _region(order: JsonObject) -> Region:
    return Region(x=_number(order.get("x")), y=_number(order.get("y")), zoom=_number(order.get("zoom")))
