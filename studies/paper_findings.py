"""In what share of the viewpoints does each of the paper's findings hold?

    rig sweep studies/paper-poses.toml
    rig sweep studies/paper-rooms.toml
    python studies/paper_findings.py runs/paper-poses runs/paper-rooms [--figure docs/images/paper-findings.svg]

Prints the tables of docs/explanation/paper-from-many-viewpoints.md. A viewpoint counts when all six configurations are
there from it; "as stated" are those that light 42 to 58 % of the room, as the paper's do.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rig.paper.published import ClaimedFigures, published_effects
from rig.paper.records import Effect
from rig.sweeps.folder import read_lines
from rig.sweeps.records import PointLine

POSE = ("x_m", "y_m", "z_m", "azimuth_deg", "elevation_deg", "hfov_deg")
AS_STATED = (0.42, 0.58)
"""Coverage of the reference; the paper says 50 %."""
CONFIGURATIONS: Mapping[str, Mapping[str, object]] = {
    "reference": {"reflectance": 0.7, "photograph": "outdoor"},
    "indoor": {"reflectance": 0.7, "photograph": "indoor"},
    "grey": {"reflectance": 0.7, "photograph": "grey"},
    "dark_walls": {"reflectance": 0.4, "photograph": "outdoor"},
    "quarter": {"picture_scale": 0.435, "reflectance": 0.7},
    "no_ceiling": {"ceiling": False, "reflectance": 0.7},
}
WHOLE_ROOM = {"picture_scale": 1.0, "ceiling": True}
Pose = tuple[float, ...]
Lines = dict[Pose, dict[str, PointLine]]


@dataclass(frozen=True)
class Held:
    """A finding, and where it holds: among all viewpoints, and among those that light as much as the paper says."""

    effect: Effect
    all: tuple[int, int]
    stated: tuple[int, int]


def by_pose(folders: Sequence[Path]) -> Lines:
    poses: Lines = {}
    for line in (line for folder in folders for line in read_lines(folder) if line.status == "done"):
        pose = tuple(float(line.inputs[name]) for name in POSE)
        for name, wanted in CONFIGURATIONS.items():
            if all(line.inputs[key] == value for key, value in {**WHOLE_ROOM, **wanted}.items()):
                poses.setdefault(pose, {})[name] = line
    return {pose: lines for pose, lines in poses.items() if len(lines) == len(CONFIGURATIONS)}


def claimed(line: PointLine) -> ClaimedFigures:
    figures = line.figures
    return ClaimedFigures(
        indirect=figures["indirect_mean"],
        share_white=figures["share_white"],
        without=figures["uncompensated_mean"],
        without_sd=figures["uncompensated_sd"],
        compensated=figures["paper_mean"],
        compensated_sd=figures["paper_sd"],
    )


def held(poses: Lines) -> list[Held]:
    found: list[tuple[bool, tuple[Effect, ...]]] = []
    for lines in poses.values():
        coverage = lines["reference"].figures["coverage"]
        effects = published_effects({name: claimed(line) for name, line in lines.items()})
        found.append((AS_STATED[0] <= coverage <= AS_STATED[1], effects))
    rows = []
    for k, effect in enumerate(found[0][1]):
        everywhere = [effects[k].reproduced for _, effects in found]
        stated = [effects[k].reproduced for is_stated, effects in found if is_stated]
        rows.append(Held(effect, (sum(everywhere), len(everywhere)), (sum(stated), len(stated))))
    return rows


def share(counts: tuple[int, int]) -> str:
    return f"{100 * counts[0] / counts[1]:.0f} % ({counts[0]} of {counts[1]})" if counts[1] else "none"


def gains(folder: Path) -> Iterator[tuple[float, str, dict[str, float]]]:
    """Yield (reflectance, photograph, share of viewpoints in which each rule lowers the mean error)."""
    cells: dict[tuple[float, str], list[PointLine]] = {}
    for line in read_lines(folder):
        if line.status == "done":
            cells.setdefault((line.inputs["reflectance"], line.inputs["photograph"]), []).append(line)
    for (reflectance, photograph), lines in sorted(cells.items(), key=lambda cell: (cell[0][1], cell[0][0])):
        better = {
            rule: float(np.mean([line.figures[f"{rule}_mean"] < line.figures["uncompensated_mean"] for line in lines]))
            for rule in ("paper", "exact", "bounded")
        }
        medians = {
            f"median {rule}": float(np.median([line.figures[f"{rule}_mean"] for line in lines]))
            for rule in ("uncompensated", "paper", "exact", "bounded")
        }
        yield reflectance, photograph, better | medians


def figure_of(folder: Path) -> Figure:
    rows = list(gains(folder))
    photographs = list(dict.fromkeys(photograph for _, photograph, _ in rows))
    figure = Figure(figsize=(11.0, 3.4), layout="constrained")
    panels = figure.subplots(1, len(photographs), sharey=True, squeeze=False)[0]
    for axes, photograph in zip(panels, photographs, strict=True):
        of_it = [(reflectance, values) for reflectance, other, values in rows if other == photograph]
        for rule, colour in (("uncompensated", "#5d6678"), ("paper", "#c4561c"), ("bounded", "#2557a7")):
            axes.plot(
                [reflectance for reflectance, _ in of_it],
                [values[f"median {rule}"] for _, values in of_it],
                "o-",
                color=colour,
                markersize=3,
                label=rule,
            )
        axes.set_title(photograph, fontsize=10)
        axes.set_xlabel("reflectance of all walls", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("median over viewpoints of the\nmean error, grey levels", fontsize=9)
    panels[-1].legend(frameon=False, fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("poses", type=Path)
    parser.add_argument("rooms", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    poses = by_pose([given.poses, given.rooms])
    print(f"{len(poses)} viewpoints with all six configurations\n")
    print("| finding | the paper | all viewpoints | that light 42 to 58 % |\n|---|---|---:|---:|")
    for row in held(poses):
        print(f"| {row.effect.effect} | {row.effect.published} | {share(row.all)} | {share(row.stated)} |")
    print("\n| photograph | reflectance | paper | exact | bounded | medians: none, paper, exact, bounded |")
    print("|---|---:|---:|---:|---:|---|")
    for reflectance, photograph, values in gains(given.poses):
        better = " | ".join(f"{100 * values[rule]:.0f} %" for rule in ("paper", "exact", "bounded"))
        rules = ("uncompensated", "paper", "exact", "bounded")
        medians = ", ".join(f"{values[f'median {rule}']:.1f}" for rule in rules)
        print(f"| {photograph} | {reflectance:g} | {better} | {medians} |")
    if given.figure is not None:
        figure_of(given.poses).savefig(given.figure, metadata={"Date": None} if given.figure.suffix == ".svg" else {})


if __name__ == "__main__":
    main()
