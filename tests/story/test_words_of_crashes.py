"""What a crash hit and how it lay, in words, on endings made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.vehicle import VehicleKind
from attlog.segments.crash import Ending
from attlog.segments.model import Segment, Segments
from attlog.story.headline import _crash, _lies, _where


def ending(kind: Any, t: float, size: float, lies: float | None = None) -> Ending:
    unit = {"impact": "g", "overturn": "deg", "tumble": "deg/s"}[kind]
    return Ending(kind, t, t + 0.1, size, unit, "seen", lies, 400.0)


def test_a_vehicle_lies_upside_down_at_an_angle_or_upright() -> None:
    said = {None: "", 151.0: ", lay upside down", 149.6: ", lay at 150°", 16.0: ", lay at 16°", 15.0: ", upright"}
    assert {deg: _lies(ending("impact", 1.0, 5.0, deg)) for deg in said} == said


@pytest.mark.parametrize(
    ("group", "what", "full", "short"),
    [
        (
            [ending("impact", 10.0, 7.0, 40.0)],
            "the ground",
            "Hit the ground at 10.0 s (7.0 g), lay at 40°",
            "Hit the ground at 10.0 s (7.0 g)",
        ),
        (
            [ending("overturn", 9.0, 120.0), ending("impact", 10.0, 7.0, 40.0)],
            "the ground",
            "Rolled to 120° at 9.0 s and hit the ground at 10.0 s (7.0 g)",
            "Hit the ground at 10.0 s (7.0 g)",
        ),
        (
            [ending("impact", 10.0, 7.0), ending("overturn", 10.4, 120.0)],
            "something",
            "Hit something at 10.0 s (7.0 g) and turned over to 120°",
            "Hit something at 10.0 s (7.0 g)",
        ),
        (
            [ending("overturn", 9.0, 80.0), ending("overturn", 12.0, 178.0, 170.0)],
            "the ground",
            "Fell over at 9.0 s (80°) and turned over at 12.0 s (178°), lay upside down",
            "Fell over at 9.0 s (80°)",
        ),
        (
            [ending("overturn", 9.0, 80.0)],
            "",
            "Flipped over at take-off at 9.0 s (80°)",
            "Flipped over at take-off at 9.0 s (80°)",
        ),
        ([ending("tumble", 9.0, 700.0)], "the ground", "Tumbled at 9.0 s (700°/s)", "Tumbled at 9.0 s (700°/s)"),
        ([ending("impact", 10.0, 7.0)], "", "Hit something at 10.0 s (7.0 g)", "Hit something at 10.0 s (7.0 g)"),
    ],
)
def test_a_crash_is_told_by_its_blow_its_overturn_or_its_tumble(
    group: list[Ending], what: str, full: str, short: str
) -> None:
    assert _crash(group, what) == (full, short)


@pytest.mark.parametrize(("height", "hit"), [(5.1, "something"), (4.9, "the ground"), (np.nan, "the ground")])
def test_above_five_metres_it_is_not_the_ground_that_was_hit(height: float, hit: str) -> None:
    level = SimpleNamespace(above=np.array([0.0, 50.0, height]))
    low = SimpleNamespace(above=np.array([0.0, 50.0, 1.0]))
    air: Any = SimpleNamespace(levels=[low, level], grid=SimpleNamespace(index=lambda t: 2))
    flown = Segments([Segment("airborne", 1.0, 20.0)], air=air)
    assert _where(VehicleKind.MULTIROTOR, flown, 15.0) == hit
    assert _where(VehicleKind.PLANE, flown, 15.0) == "the ground"
    assert _where(VehicleKind.MULTIROTOR, Segments(air=air), 15.0) == ""
    assert _where(VehicleKind.MULTIROTOR, Segments([Segment("airborne", 1.0, 20.0)]), 15.0) == "the ground"
