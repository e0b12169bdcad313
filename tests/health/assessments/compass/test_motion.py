"""Why no attitude judges a compass: each reason in its turn, and the acceleration that shows a heading."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.health.assessments.compass import motion
from tests.health.assessments.onboard.made import OMEGA, SPEED, case, flight

T = np.arange(0.0, 100.0, 0.1)


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A case in which everything speaks for an attitude by motion."""
    monkeypatch.setattr(motion, "air_spans", lambda segments: segments.flown)
    monkeypatch.setattr(motion.declination, "model", lambda log: log.model)
    monkeypatch.setattr(motion, "acceleration", lambda log, told, case: log.moved)
    told = SimpleNamespace(t=T, sigma_heading=np.full(len(T), 0.05), quality={})
    return SimpleNamespace(
        segments=SimpleNamespace(flown=[(20.0, 80.0)]), log=SimpleNamespace(model=1, moved=9.9), motion=told
    )


def test_each_reason_is_told_in_its_turn(judged: Any) -> None:
    assert motion.why_none(judged) == ""
    judged.log.moved = 0.99 * motion.LEAST_M_S2
    assert "shows no heading" in motion.why_none(judged)
    judged.log.moved = 1.01 * motion.LEAST_M_S2
    assert motion.why_none(judged) == ""
    judged.motion.sigma_heading[:] = np.pi
    judged.motion.quality["heading_why"] = "GNSS jumps"
    assert motion.why_none(judged) == "Motion shows no heading that can be trusted: GNSS jumps."
    judged.motion.sigma_heading[:] = np.nan
    judged.motion.sigma_heading[T < 19.0] = 0.05
    assert motion.why_none(judged) == "No attitude by motion covers the flight."
    judged.motion.t = T + 200.0
    assert motion.why_none(judged) == "No attitude by motion covers the flight."
    judged.motion = None
    assert "Without GNSS velocity" in motion.why_none(judged)
    judged.log.model = None
    assert "no position" in motion.why_none(judged)
    judged.segments.flown = []
    assert "no flight" in motion.why_none(judged)
    judged.segments = None
    assert "No inertial unit" in motion.why_none(judged)


def test_the_acceleration_is_its_rms_over_the_flight_whichever_of_gnss_and_force_shows_less() -> None:
    """Sines of 3.6 and 1.59 m/s^2 north and east, without the mean of each half minute."""
    log = flight()
    one = case(log)
    assert one.motion is not None
    whole = np.sqrt(np.sum((SPEED * OMEGA) ** 2) / 2.0)
    found = motion.acceleration(log, one.motion, one)
    assert found == pytest.approx(whole, rel=0.1)
    log.gnss[0].vel_ned *= 0.5
    assert motion.acceleration(log, one.motion, one) == pytest.approx(0.5 * found, rel=0.1)
    log.gnss = []
    assert motion.acceleration(log, one.motion, one) == 0.0
