"""What the planner says matte patches would be wrong by, held against more: python benchmarks/gloss_honesty.py [SCENE].

``rig simulate`` estimates it on a plan of 4 %, tens of patches. Here the same figures stand beside those of a plan
of 1 %: error between surfaces, as seen, and in highlights, per cent of white; and the error of the glossy
solution at 2 % against one of four or sixteen times the patches and eight times the rays.
"""

from __future__ import annotations

import sys
import time

from rig.offline.gloss import PROBE_PERCENT, effect_on, with_gloss
from sim.planning.gloss import gloss_of_cells, glossy_simulation, refined_gloss_check
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from sim.scenes.catalogue import SURFACES

SCENES = ("paper-room", "room-with-box", "sloped-room", "corner")
GLOSS = ((0.2, 0.1), (0.2, 0.3), (0.2, 0.8), (0.02, 0.3))
"""Share and roughness."""
REFLECTANCE = 0.5


def main() -> int:
    """Print a row for each scene and gloss."""
    for name in sys.argv[1:] or SCENES:
        entry = SURFACES[name]
        for share, roughness in GLOSS:
            scene = with_gloss(entry.build(), share, roughness, (REFLECTANCE,))
            if scene.gloss is None:
                continue
            figures = []
            for tolerance in (PROBE_PERCENT, 1.0):
                started = time.process_time()
                made = plan(scene.as_matte, tolerance, entry.light)
                effect = effect_on(made, scene.surface, scene.gloss)
                seconds = time.process_time() - started
                figures += [100 * effect.between, 100 * effect.seen, 100 * effect.highlight, seconds]
            made = plan(scene.as_matte, 2.0, entry.light)
            gloss = gloss_of_cells(made.cells, scene.surface, scene.gloss)
            found = glossy_simulation(simulate(made.cells, made.light, made.model), made.light, gloss)
            error = 100 * refined_gloss_check(found, made.light, made.model, 16 * made.patches).rms
            print(
                f"{name:14s} {share:.2f} {roughness:.1f}  between {figures[0]:.2f} / {figures[4]:.2f}  seen "
                f"{figures[1]:.2f} / {figures[5]:.2f}  highlight {figures[2]:.2f} / {figures[6]:.2f}  "
                f"({figures[3]:.2f} / {figures[7]:.2f} s)  error at 2 %: {error:.2f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
