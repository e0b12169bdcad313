"""What a row shows around one stroke: errors about its axis, ends and settling, by closed forms in each axis."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.steps import curves, settling, step_error
from attlog.metrics.steps import events as steps
from attlog.metrics.steps.curves import Curve
from attlog.metrics.steps.events import StepEvent
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 12.0, 0.01)


def stroke(degrees: float) -> np.ndarray:
    """An angle that moves from 0 to so many deg between 5 and 5.5 s."""
    return np.radians(degrees) * np.clip((T - 5.0) / 0.5, 0.0, 1.0)


def shown(axis: int, degrees: float, error_deg: np.ndarray, beside_deg: float = 0.0) -> Curve:
    """The curve of a row that is off by an error about the axis of the stroke, and by another about the next axis."""
    start = rotation.from_euler(0.15, -0.25, 1.4)
    q = rotation.multiply(np.tile(start, (len(T), 1)), rotation.from_rotvec(stroke(degrees)[:, None] * np.eye(3)[axis]))
    vector = np.radians(error_deg)[:, None] * np.eye(3)[axis] + np.radians(beside_deg) * np.eye(3)[(axis + 1) % 3]
    row = flights.row(T, rotation.multiply(q, rotation.from_rotvec(vector)))
    case = flights.case([row], [Segment("continuous", 0, 12)], (T, q))
    (event,) = steps.of_reference(case)
    (found,) = curves.of_events(case, row, [event])
    assert found.event.axis == axis
    return found


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("degrees", [30.0, -30.0])
def test_an_error_counts_along_the_stroke_from_its_mean_before_the_onset(axis: int, degrees: float) -> None:
    """4 deg before the onset are nobody's; 2 deg more in the way of the stroke are 2, whatever its sign."""
    way = np.sign(degrees)
    error = 4.0 + way * np.where(T >= 5.2, 2.0, 0.0)
    found = shown(axis, degrees, error, beside_deg=0.5)
    later = found.t > 5.25
    np.testing.assert_allclose(found.error[later], 2.0, atol=0.05)
    np.testing.assert_allclose(found.error[found.t < found.event.onset], 0.0, atol=0.05)
    np.testing.assert_allclose(found.reference[found.t > 5.55], 30.0, atol=0.4)
    np.testing.assert_allclose(np.interp(5.25, found.t, found.reference), 15.0, atol=0.5)
    assert found.seconds[0] == pytest.approx(found.t[0] - found.event.onset)


def test_the_reference_is_known_to_the_last_sample_of_the_event() -> None:
    found = shown(0, 30.0, 0.0 * T)
    assert found.t[-1] == pytest.approx(found.event.end, abs=0.011)
    rising = shown(0, 30.0, np.where(T >= 5.5, T - 5.5, 0.0))
    np.testing.assert_allclose(rising.error[-1], rising.t[-1] - 5.5, atol=0.05)


EVENT = StepEvent(0, 5.0, 5.25, 5.45, -20.0, 4.5, 6.45)
AT = np.round(np.arange(4.5, 6.45, 0.01), 2)


def curve(error: np.ndarray, reference: np.ndarray | None = None) -> Curve:
    return Curve(EVENT, AT, 20.0 * np.clip((AT - 5.0) / 0.5, 0.0, 1.0) if reference is None else reference, error)


def test_an_overshoot_is_the_peak_beyond_the_references_in_percent_of_the_step() -> None:
    for error, percent in ((3.0, 15.0), (-3.0, -15.0)):
        overshoot, _, _ = settling.of_events([curve(np.where(AT > 5.6, error, 0.0))])
        assert overshoot.tolist() == [pytest.approx(percent if error > 0 else 0.0)]
    flat, _, _ = settling.of_events([curve(np.where(AT > 5.1, -3.0, 0.0))])
    assert flat.tolist() == [pytest.approx(-15.0)]
    early, _, _ = settling.of_events([curve(np.where(AT < 4.99, 50.0, 0.0))])
    assert early.tolist() == [pytest.approx(0.0)]


def test_a_step_has_settled_when_its_error_stays_within_a_twentieth() -> None:
    inside = np.where((AT > 5.1) & (AT < 5.805), -1.1, 0.9)
    _, seconds, never = settling.of_events([curve(inside), curve(0.0 * AT + 0.99), curve(0.0 * AT + 1.01)])
    assert seconds.tolist() == [pytest.approx(0.81), 0.0, pytest.approx(AT[-1] - 5.0)]
    assert never == 1
    assert settling._from_zero("settling_s", (-1.0, 3.0)) == (0.0, 3.0)
    assert settling._from_zero("overshoot_pct", (-1.0, 3.0)) == (-1.0, 3.0)
    assert settling._from_zero("settling_s", None) is None


def test_an_error_after_a_step_is_the_mean_of_fifty_milliseconds_either_way() -> None:
    one = curve(AT**2)
    near = np.abs(AT - 5.95) <= 0.05 + 1e-9
    assert step_error.error_at(one, 5.95) == pytest.approx(np.mean(AT[near] ** 2), rel=1e-2)
    assert step_error.error_at(one, 6.7) is None
    slow = Curve(EVENT, AT[::40], 0.0 * AT[::40], AT[::40])
    assert step_error.error_at(slow, 5.68) == pytest.approx(5.7)
    assert step_error.error_at(slow, 4.3) is None
    found = step_error.errors_after([one], 0.5)
    assert (found.ids.tolist(), found.stroke.tolist()) == ([5000], [20.0])
    np.testing.assert_allclose(step_error.percent(found), 5.0 * found.deg)
    assert step_error.magnitude(step_error.errors_after([curve(-AT)], 0.5))[0] == pytest.approx(5.95, abs=0.01)
