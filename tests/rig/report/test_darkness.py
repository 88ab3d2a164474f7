"""What the report says of black: the sensor's level, the projector's black and the room's light, apart."""

from __future__ import annotations

from rig.report.room import darkness_text
from rig.stages.light.darkness import DarknessRecord

APART = DarknessRecord(
    sensor_share_of_full_scale=0.0156,
    black_share_of_white=0.003,
    projector_black_share=0.00067,
    projector_black_sigma=0.00002,
    room_light_share=0.00233,
)


def test_the_three_are_said_apart_with_their_errors() -> None:
    words = darkness_text(APART)
    assert "the camera's level is 1.56 % of full scale" in words
    assert "0.067 ± 0.002 % are the projector's black, 0.233 % the room's light" in words


def test_where_the_border_is_not_seen_it_says_that_nothing_tells_them_apart() -> None:
    unknown = DarknessRecord(
        sensor_share_of_full_scale=0.0156,
        black_share_of_white=0.003,
        projector_black_share=None,
        projector_black_sigma=None,
        room_light_share=None,
    )
    assert "seen too little to tell the projector's black from room light" in darkness_text(unknown)


def test_a_session_from_before_says_nothing() -> None:
    assert darkness_text(None) == ""
