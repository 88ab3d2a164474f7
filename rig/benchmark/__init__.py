"""``rig bench``: problem x method x tolerance against error, seconds and memory, each peer in the same process."""

from __future__ import annotations

from rig.benchmark.run import BENCHES, run_bench

__all__ = ["BENCHES", "run_bench"]
