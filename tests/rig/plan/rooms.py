"""Small rooms for the tests of plans."""

from typing import Any

from rig.plan.request import PlanRequest, request_of


def room(**changes: Any) -> PlanRequest:
    """A closed room in coarse patches with a projector that lights about half of it; whole tables may be changed."""
    return request_of({**PLAIN, **changes})


def projector(**changes: Any) -> dict[str, Any]:
    """The plain projector with other numbers."""
    return {**PLAIN["projector"], **changes}


PLAIN: dict[str, Any] = {
    "room": {"size_m": [4.8, 4.8, 2.4], "patch_m": 0.8},
    "paint": {"all": 0.7},
    "projector": {
        "throw_ratio": 0.4,
        "lumens": 3000,
        "contrast": 1000,
        "width_px": 1600,
        "height_px": 1200,
        "position_m": [1.2, 1.2, 1.2],
        "look_at_m": [2.2, 2.2, 1.1],
    },
    "show": {"white_cdm2": 20, "pictures": ["grey"], "strategies": ["direct"], "width_px": 64},
}
