"""Which of the strategies that were shown stands for 'compensated'."""

import pytest

from rig.stages.compensation import CompensationRecord, ComputedStrategy


@pytest.mark.parametrize(
    ("asked", "compensated"),
    [
        (("none", "direct", "paper", "exact", "bounded"), "bounded"),
        (("none", "paper", "halfway"), "paper"),
        (("none", "halfway"), "halfway"),
        (("none", "direct", "tikhonov", "series"), "tikhonov"),
        (("halfway",), "halfway"),
        (("none", "direct"), "direct"),
        (("none",), "none"),
    ],
)
def test_a_strategy_of_another_name_stands_for_compensated_where_it_is_all_there_is(
    asked: tuple[str, ...], compensated: str
) -> None:
    one = ComputedStrategy(clipped_share=0.0, iterations=1, solver_rms=0.0, notes={})
    assert CompensationRecord(strategies=dict.fromkeys(asked, one), active_share=1.0).best == compensated
