"""Where a picture is wanted, and what must stay dark: table ``[target]`` of a profile."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.files.toml import Table
from rig.records import JsonObject

Place = Literal["projector", "camera", "panorama", "cube", "surface"]
Corner = tuple[float, float]


class TargetTable(Table):
    """Where a picture is wanted. A point or a length is in metres, in the room as `rig model` measures it."""

    placed: Place = "projector"
    """``projector``: pixel by pixel; ``camera``: as the camera should see it; ``panorama`` (equirectangular) and
    ``cube`` (a cross of 4 × 3 squares, or a strip of 6): as a viewer sees it from a point; ``surface``: on a wall."""
    viewer_m: tuple[float, float, float] | None = None
    """x, y, z of the viewer's eyes, of a panorama or cube."""
    turn_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """By which the middle of a panorama or cube lies to the right of where the projector looks."""
    surface: str | None = None
    """Of ``surface``: x0, x1, y0, y1, floor, ceiling, or ``thing N`` as the report calls what stands in the room."""
    corners_m: tuple[Corner, Corner, Corner, Corner] | None = None
    """Where the picture's upper left, upper right, lower right and lower left corners lie on it: to the right and up
    from its lower left corner, seen from inside the room. Without: it fills the surface, cropped."""
    dark: str | None = None
    """Picture whose black parts no light must go to, relative to the profile: people, windows, exhibits."""
    dark_seen_by: Literal["camera", "projector"] = "camera"
    """Whose picture it was painted over."""

    @property
    def placement(self) -> JsonObject | None:
        """All that decides where a picture lies; None where that is pixel by pixel."""
        if self.placed == "projector":
            return None
        return self.model_dump(mode="json", exclude={"dark", "dark_seen_by"}, exclude_defaults=True)

    @property
    def words(self) -> str:
        """Where a picture lies, in words."""
        viewer = "" if self.viewer_m is None else ", ".join(f"{one:g}" for one in self.viewer_m)
        return {
            "projector": "",
            "camera": "as the camera should see it",
            "panorama": f"a panorama seen from {viewer} m",
            "cube": f"a cube map seen from {viewer} m",
            "surface": f"on {self.surface}",
        }[self.placed]

    @model_validator(mode="after")
    def _says_all(self) -> TargetTable:
        is_seen = self.placed in ("panorama", "cube")
        if is_seen and self.viewer_m is None:
            raise ValueError(f"a {self.placed} needs viewer_m, where the viewer's eyes are: x, y, z in metres")
        if not is_seen and (self.viewer_m is not None or self.turn_deg):
            raise ValueError(f"viewer_m and turn_deg belong to a panorama or cube, not to placed = {self.placed!r}")
        if self.placed == "surface" and self.surface is None:
            raise ValueError("placed = 'surface' needs surface: x0, x1, y0, y1, floor, ceiling, or 'thing N'")
        if self.placed != "surface" and (self.surface is not None or self.corners_m is not None):
            raise ValueError(f"surface and corners_m belong to placed = 'surface', not to {self.placed!r}")
        return self
