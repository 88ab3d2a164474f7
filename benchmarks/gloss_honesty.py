"""What the planner says matte patches would be wrong by, held against more: python benchmarks/gloss_honesty.py [SCENE].

    .venv/bin/python benchmarks/gloss_honesty.py paper-room
    .venv/bin/python benchmarks/gloss_honesty.py --bend paper-room sloped-room
    .venv/bin/python benchmarks/gloss_honesty.py --kept paper-room sloped-room
    .venv/bin/python benchmarks/gloss_honesty.py --pairs paper-room corner-with-ball

``rig simulate`` estimates it on a plan of 4 %, tens of patches. Here the same figures stand beside those of a plan
of 1 %: error between surfaces, as seen, and in highlights, per cent of white; and the error of the glossy
solution at 2 % against one of four or sixteen times the patches and eight times the rays.

``--bend``: how much larger the error of a plan's patches is with lobes than with matte patches that send back as much,
both on sixteenths, and what it adds, in squares, over the share of light that lobes send
(``sim.planning.gloss.BEND``). ``--kept``: whether ``rig simulate`` keeps its tolerance; exit status 1 where not.
``--pairs``: processor time of a pair of rays in light from everywhere and from a place (``sim.planning.gloss.PAIR_S``).
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from rig.offline.gloss import PROBE_PERCENT, effect_on, with_gloss
from rig.offline.simulate import SimulationRequest, run_simulate
from sim.planning.check import refined_check
from sim.planning.gloss import gloss_of_cells, glossy_simulation, refined_gloss_check
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from sim.scenes.catalogue import SURFACES
from sim.threads import set_threads

SCENES = ("paper-room", "room-with-box", "sloped-room", "corner")
GLOSS = ((0.2, 0.1), (0.2, 0.3), (0.2, 0.8), (0.02, 0.3))
"""Share and roughness."""
REFLECTANCE = 0.5
BENDING = (
    (0.5, 0.3, 0.1),
    (0.5, 0.3, 0.3),
    (0.2, 0.6, 0.1),
    (0.5, 0.1, 0.3),
    (0.3, 0.5, 0.2),
    (0.5, 0.2, 0.8),
)
"""Matte reflectance, share and roughness."""
PAIRS = (64, 256)


def main() -> int:
    """Print a row for each scene and gloss."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--bend", action="store_true")
    parser.add_argument("--kept", action="store_true")
    parser.add_argument("--pairs", action="store_true")
    parser.add_argument("--percent", type=float, default=4.0, help="tolerance of --bend and --kept")
    wanted = parser.parse_args()
    set_threads(1)
    row = bend_row if wanted.bend else kept_row if wanted.kept else pair_row if wanted.pairs else effect_row
    glosses = BENDING if wanted.bend or wanted.kept else [(REFLECTANCE, *gloss) for gloss in GLOSS]
    kept = [row(name, gloss, wanted.percent) for name in wanted.scenes for gloss in glosses]
    return 0 if all(kept) else 1


def bend_row(name: str, gloss: tuple[float, float, float], percent: float) -> bool:
    """Print by how much more light bends with lobes; always True."""
    entry, (reflectance, share, roughness) = SURFACES[name], gloss
    scene = with_gloss(entry.build(), share, roughness, (reflectance,))
    if scene.gloss is None:
        return True
    made = plan(scene.as_matte, percent, entry.light)
    matte = simulate(made.cells, made.light, made.model)
    lobes = gloss_of_cells(made.cells, scene.surface, scene.gloss)
    glossy = glossy_simulation(matte, made.light, lobes)
    errors = (
        refined_gloss_check(glossy, made.light, made.model, 2 * 16 * made.patches).rms,
        refined_check(matte, made.light, made.model, 16 * made.patches).rms,
    )
    sent = float(made.cells.areas @ lobes.mean_albedo / (made.cells.areas @ made.cells.reflectance))
    ratio = errors[0] / errors[1]
    print(
        f"{name:14s} matte {reflectance:.2f} gloss {share:.2f} roughness {roughness:.1f}: {made.patches} patches, "
        f"{100 * errors[0]:.2f} % with lobes, {100 * errors[1]:.2f} % without, lobes send {sent:.2f} of the light, "
        f"added over that {np.sqrt(max(ratio**2 - 1, 0.0)) / sent:.2f}",
        flush=True,
    )
    return True


def pair_row(name: str, gloss: tuple[float, float, float], percent: float) -> bool:
    """Print what a pair of rays takes, from two numbers of them; always True."""
    reflectance, share, roughness = gloss
    scene = with_gloss(SURFACES[name].build(), share, roughness, (reflectance,))
    if scene.gloss is None:
        return True
    for light in ("uniform", "projector"):
        made = plan(scene.as_matte, percent, light, one_number=True)
        matte = simulate(made.cells, made.light, made.model)
        lobes, taken_s = gloss_of_cells(made.cells, scene.surface, scene.gloss), []
        for rays in PAIRS:
            started = time.process_time()
            glossy_simulation(matte, made.light, lobes, rays=rays)
            taken_s.append(time.process_time() - started)
        pair_us = 1e6 * (taken_s[1] - taken_s[0]) / (made.patches * (PAIRS[1] - PAIRS[0]))
        print(
            f"{name:16s} gloss {share:.2f} roughness {roughness:.1f} {light:9s} {made.patches} patches, "
            f"{pair_us:.1f} us a pair",
            flush=True,
        )
    return True


def kept_row(name: str, gloss: tuple[float, float, float], percent: float) -> bool:
    """Print the error that ``rig simulate --check`` finds, and tell if it is within the tolerance."""
    reflectance, share, roughness = gloss
    request = SimulationRequest(
        scene=name, tolerance=percent, reflectance=(reflectance,), gloss=share, roughness=roughness
    )
    started = time.process_time()
    result = run_simulate(request, check=True)
    error = np.inf if result.actual is None or result.actual.error is None else result.actual.error
    print(
        f"{name:14s} matte {reflectance:.2f} gloss {share:.2f} roughness {roughness:.1f}: "
        f"{result.plan.patches} patches, {percent:g} % allowed, "
        f"{result.estimated.error:.2f} expected, {error:.2f} actual "
        f"({time.process_time() - started:.1f} s)",
        flush=True,
    )
    return bool(error <= percent)


def effect_row(name: str, gloss: tuple[float, float, float], _percent: float) -> bool:
    """Print what matte patches would be wrong by, from a coarse and a fine plan; always True."""
    entry, (reflectance, share, roughness) = SURFACES[name], gloss
    scene = with_gloss(entry.build(), share, roughness, (reflectance,))
    if scene.gloss is None:
        return True
    figures = []
    for tolerance in (PROBE_PERCENT, 1.0):
        started = time.process_time()
        made = plan(scene.as_matte, tolerance, entry.light)
        effect = effect_on(made, scene.surface, scene.gloss)
        seconds = time.process_time() - started
        figures += [100 * effect.between, 100 * effect.seen, 100 * effect.highlight, seconds]
    made = plan(scene.as_matte, 2.0, entry.light)
    lobes = gloss_of_cells(made.cells, scene.surface, scene.gloss)
    found = glossy_simulation(simulate(made.cells, made.light, made.model), made.light, lobes)
    error = 100 * refined_gloss_check(found, made.light, made.model, 16 * made.patches).rms
    print(
        f"{name:14s} {share:.2f} {roughness:.1f}  between {figures[0]:.2f} / {figures[4]:.2f}  seen "
        f"{figures[1]:.2f} / {figures[5]:.2f}  highlight {figures[2]:.2f} / {figures[6]:.2f}  "
        f"({figures[3]:.2f} / {figures[7]:.2f} s)  error at 2 %: {error:.2f}",
        flush=True,
    )
    return True


if __name__ == "__main__":
    raise SystemExit(main())
