"""Do axes and offset of the accelerometer show in flight, and is no error of the attitude taken for them?"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.model import FlightLog, Gnss
from attlog.reference import ReferenceOptions, choose, heading_sources
from attlog.reference.accelerometer_checks import GRAVITY_M_S2, accelerometer_fault
from attlog.segments import Segment, Segments
from tests.reference.flights import flight

Array = NDArray[np.float64]
SECONDS = 80.0
PHASES = Segments(
    [
        Segment("continuous", 0.0, SECONDS),
        Segment("rest.long", 0.0, 18.0),
        Segment("airborne", 20.0, SECONDS),
        Segment("hover", 60.0, SECONDS),
    ]
)


def windy(change: Callable[[Array, Array], Array], turning_deg_s: float = 6.0, lean_deg: float = 15.0) -> FlightLog:
    """Fly in a wind from north that leans the vehicle while it turns; ``change(t, force)`` is the fault."""
    log = flight(SECONDS, seed=3)
    t = log.imus[0].acc.t
    flown = np.clip((t - 20.0) / 2.0, 0.0, 1.0)
    q = attitude(t, flown, turning_deg_s, lean_deg)
    step = 0.01
    ahead = attitude(t + step, np.clip((t + step - 20.0) / 2.0, 0.0, 1.0), turning_deg_s, lean_deg)
    random = np.random.default_rng(4)
    force = rotation.rotate_inverse(q, np.array([0.0, 0.0, -GRAVITY_M_S2])) + 0.3 * random.normal(size=(len(t), 3))
    log.imus[0].gyro.x = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q), ahead)) / step
    log.imus[0].acc.x = change(t, force)
    onboard = log.attitudes["ATT"]
    onboard.q = attitude(onboard.t, np.clip((onboard.t - 20.0) / 2.0, 0.0, 1.0), turning_deg_s, lean_deg)
    fixes = np.arange(0.5, SECONDS, 0.2)
    still, zero = np.zeros((len(fixes), 3)), np.zeros(len(fixes))
    log.gnss = [Gnss(0, fixes, "GPS", zero, zero, zero, still, zero, zero, zero, np.full(len(fixes), 3))]
    return log


def attitude(t: Array, flown: Array, turning_deg_s: float, lean_deg: float) -> Array:
    """Lean to the north by a share ``flown``, whatever the heading."""
    lean = rotation.from_rotvec(np.outer(-np.radians(lean_deg) * flown, [0.0, 1.0, 0.0]))
    zero = np.zeros(len(t))
    return rotation.multiply(lean, rotation.from_euler(zero, zero, np.radians(turning_deg_s) * np.maximum(t - 20.0, 0)))


def sound(t: Array, force: Array) -> Array:
    return force


def exchanged(t: Array, force: Array) -> Array:
    return force[:, [1, 0, 2]]


def turned(t: Array, force: Array) -> Array:
    return rotation.rotate(rotation.from_euler(np.radians(45.0), 0.0, 0.0), force)


def stepped(t: Array, force: Array) -> Array:
    return force + np.outer(t >= 50.0, [3.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (exchanged, ("other axes",)),
        (lambda t, force: force * [-1.0, 1.0, 1.0], ("other axes",)),
        (lambda t, force: force + np.array([0.0, 3.0, 0.0]), ("y +3.0", "only less")),
        (turned, ("turned by 45 deg", "mounting")),
        (stepped, ("x +3.0", "from 50 s on")),
    ],
)
def test_axes_offset_mounting_and_step_show_in_flight_and_accuse_no_attitude(
    fault: Callable[[Array, Array], Array], words: tuple[str, ...]
) -> None:
    log = windy(fault)
    found = accelerometer_fault(log, PHASES)
    assert all(word in found for word in words)
    reference = choose(log, PHASES, ReferenceOptions())
    assert reference.kind == "onboard"
    assert "onboard" not in reference.faults.refused
    assert heading_sources.find_gnss_motion(log, PHASES) is None


@pytest.mark.parametrize("offset", [(0.8, 0.0, 0.0), (0.0, 0.0, 3.0)])
def test_usual_and_vertical_offsets_are_no_fault_of_axes(offset: tuple[float, ...]) -> None:
    assert accelerometer_fault(windy(sound), PHASES) == ""
    assert accelerometer_fault(windy(lambda t, force: force + np.array(offset)), PHASES) == ""


@pytest.mark.parametrize("in_body", [True, False])
@pytest.mark.parametrize("turning_deg_s", [6.0, 0.0])
def test_a_tilted_attitude_is_no_fault_of_the_accelerometer(in_body: bool, turning_deg_s: float) -> None:
    """As by a biased gyro, fixed to the body, or by a wrong start, fixed to the earth."""
    log = windy(sound, turning_deg_s, lean_deg=5.0)
    onboard, tilt = log.attitudes["ATT"], rotation.from_euler(np.radians(20.0), 0.0, 0.0)
    onboard.q = rotation.multiply(onboard.q, tilt) if in_body else rotation.multiply(tilt, onboard.q)
    assert accelerometer_fault(log, PHASES) == ""
    assert "disagrees with gravity" in choose(log, PHASES, ReferenceOptions()).faults.reference


def test_axes_of_the_whole_unit_are_no_fault_of_the_accelerometer() -> None:
    """The log holds the unit as mounted, upside down, the attitude the vehicle's."""
    log = windy(lambda t, force: force * [1.0, -1.0, -1.0], turning_deg_s=20.0)
    unit = log.imus[0]
    unit.gyro.x = unit.gyro.x * [1.0, -1.0, -1.0]
    assert accelerometer_fault(log, PHASES) == ""
