"""Another compass by the size of its field: the limits of what is sound and what is off, and which one is named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Mag, Stream, TimeLine
from attlog.health.assessments.compass import choice
from attlog.health.findings import actions
from attlog.health.findings.actions import calibrated, other_compass, switching

EARTH_UT = 50.0


def mag(index: int, size: float, varying: float = 0.0) -> Mag:
    """A compass that reads ``size`` uT, half of the time more and half less by a share of it."""
    t = np.arange(0.0, 100.0, 0.1)
    direction = np.array([0.36, -0.48, 0.8])
    field = 1e-6 * size * (1.0 + varying * np.where(np.arange(len(t)) % 2, 1.0, -1.0))
    return Mag(index, Stream(t, field[:, None] * direction, "T", "FRD", f"MAG.{index}"))


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> Any:
    model = SimpleNamespace(strength_t=1e-6 * EARTH_UT)
    for place in (actions, choice):
        monkeypatch.setattr(place.declination, "model", lambda log: model)
    found: Any = SimpleNamespace(mag=0, compass_switches={}, compass_first="", params={}, replay_imu=None)
    found.param = lambda name: found.params[name].value[-1] if name in found.params else None
    return found


def advised(log: Any, used: float, other: float, varying: float = 0.0) -> str:
    """What is advised of a first compass that is in use and a second one."""
    log.mags = [mag(0, used), mag(1, other, varying)]
    return other_compass(log)


@pytest.mark.parametrize(
    ("used", "other", "varying", "advises"),
    [
        (39.5, 50.0, 0.0, True),
        (40.5, 50.0, 0.0, False),
        (60.5, 50.0, 0.0, True),
        (59.5, 50.0, 0.0, False),
        (80.0, 54.5, 0.0, True),
        (80.0, 55.5, 0.0, False),
        (80.0, 45.5, 0.0, True),
        (80.0, 44.5, 0.0, False),
        (80.0, 50.0, 0.09, True),
        (80.0, 50.0, 0.11, False),
    ],
)
def test_one_that_is_off_by_a_fifth_gives_way_to_one_within_a_tenth_that_hardly_varies(
    log: Any, used: float, other: float, varying: float, advises: bool
) -> None:
    assert bool(advised(log, used, other, varying)) is advises
    case: Any = SimpleNamespace(log=log, segments=SimpleNamespace())
    monkey = pytest.MonkeyPatch()
    monkey.setattr(choice, "air_spans", lambda segments: [(0.0, 100.0)])
    (found,) = choice._by_size(case, log.mags[0], log.mags[1:])
    monkey.undo()
    assert found.verdict == ("warning" if advises else "ok")
    assert f"MAG.0, in use, reads {used:.1f} uT of 50.0, MAG.1 " in found.text
    assert f"varying by {100 * varying:.0f} %" in found.evidence[1]


def test_the_first_sound_one_is_named_with_its_field(log: Any) -> None:
    log.mags = [mag(0, 80.0), mag(1, 70.0), mag(2, 49.0), mag(3, 51.0)]
    assert other_compass(log) == "Use MAG.2 instead, which reads 49.0 uT."
    log.mag = 3
    assert other_compass(log) == ""
    log.mag = None
    assert other_compass(log) == ""


def test_a_switch_is_named_with_what_changes_and_only_where_both_are_known(log: Any) -> None:
    log.mags = [mag(0, 80.0), mag(1, 50.0)]
    log.compass_switches = {0: "USE", 1: "USE2"}
    log.params = {"USE": TimeLine(np.zeros(1), [1.0], "P"), "USE2": TimeLine(np.zeros(1), [0.0], "P")}
    assert switching(log, log.mags[1], log.mags[0]) == {"USE2": 1.0, "USE": 0.0}
    assert other_compass(log).endswith("uT: set USE2 1 and USE 0.")
    log.params["USE2"] = TimeLine(np.zeros(1), [1.0], "P")
    assert switching(log, log.mags[1], log.mags[0]) == {"USE": 0.0}
    log.compass_switches = {0: "USE"}
    assert switching(log, log.mags[1], log.mags[0]) == {}


def test_a_compass_with_offsets_of_zero_was_never_calibrated(log: Any) -> None:
    one = mag(0, 50.0)
    assert calibrated(one)
    one.offsets = Stream(np.zeros(1), np.zeros((1, 3)), "T", "", "OFS")
    assert not calibrated(one)
    one.offsets = Stream(np.zeros(1), np.array([[0.0, 1e-6, 0.0]]), "T", "", "OFS")
    assert calibrated(one)
    one.calibrated = False
    assert not calibrated(one)
    log.mags = [mag(0, 80.0), one]
    assert other_compass(log).startswith("Calibrate and use MAG.0")
