"""What is drawn of an autopilot's messages where there are more than a page holds."""

from __future__ import annotations

from attlog.report.figures.marks import MAX_MESSAGES, drawn


def test_of_too_many_messages_the_worst_are_drawn_in_the_order_of_time() -> None:
    """syslog levels: 6 information, 4 warning, 1 alert."""
    calm = [(float(t), 6, "Reached waypoint") for t in range(MAX_MESSAGES)]
    found = drawn([*calm, (3000.0, 4, "EKF variance"), (3001.0, 1, "Crash")])
    assert len(found) == MAX_MESSAGES
    assert [row[0] for row in found[-2:]] == [3000.0, 3001.0]
    assert [row[1] for row in found[-3:]] == [0, 1, 2]
    assert [row[0] for row in found] == sorted(row[0] for row in found)
