"""What is to be done after a crash, where the log shows it."""

from __future__ import annotations

from attlog.health.findings.crashes import FLIPPED, signs
from attlog.story.event import Event

OVER = Event("overturn", 5.6, "serious", "Turned over at 5.6 s, to 178°. It then lay at 175°.")
ARMED = Event("armed", 1.0, "info", "Armed.")
LIFT = Event("liftoff", 3.0, "info", "Lift-off.")


def test_a_copter_that_flips_before_any_lift_off_has_motors_or_mount_to_check() -> None:
    assert signs([ARMED, OVER])[0].action == FLIPPED


def test_what_flew_before_it_turned_over_or_does_not_hover_is_not_sent_to_its_motors() -> None:
    assert signs([ARMED, LIFT, OVER])[0].action == ""
    assert signs([ARMED, OVER], hovers=False)[0].action == ""


def test_a_log_that_begins_long_after_arming_may_begin_in_the_air_and_a_blow_is_no_flip() -> None:
    assert signs([Event("armed", -156.2, "info", "Armed before the log begins."), OVER])[0].action == ""
    assert signs([ARMED, Event("impact", 9.0, "serious", "Hit the ground at 9.0 s: 12 g.")])[0].action == ""


def test_how_it_lay_is_told_of_the_last_move_alone() -> None:
    """It fell over and lay at 44 deg, then turned over to 175; it did not lie at 44 then."""
    fell = Event("overturn", 26.9, "serious", "Fell over at 26.9 s, to 44°. It then lay at 44°.", t_end=40.1)
    over = Event("overturn", 39.8, "serious", "Turned over at 39.8 s, to 175°.")
    assert signs([ARMED, LIFT, fell, over])[0].text == "Fell over at 26.9 s, to 44°. Turned over at 39.8 s, to 175°."
    hit = Event("impact", 41.0, "serious", "Hit the ground at 41.0 s: 9.0 g. It then lay at 170°.")
    assert signs([ARMED, LIFT, fell, over, hit])[0].text.endswith("9.0 g. It then lay at 170°.")
