"""Mountings planted in the field of a flight in closed form are named, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.core import rotation
from attlog.core.earth import MagneticField
from attlog.flight.calibration import mounting_matrix
from attlog.flight.model import Firmware, FlightLog
from attlog.reference import compass_orientation as orientation
from attlog.reference.compass_orientation import Orientation
from attlog.reference.compass_windows import Window, use_spans
from attlog.segments.model import Segment, Segments

EARTH = MagneticField(4.0, 63.0, 48e-6, "made")
HZ = 8.0


def windows(
    mounted: int = 0,
    now: int = 0,
    *,
    tilt_deg: float = 12.0,
    turned_deg: float = 200.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    motors: tuple[float, float, float] = (0.0, 0.0, 0.0),
    drift_dps: float = 0.0,
    iron: float = 0.0,
    mirror: tuple[float, float, float] = (1.0, 1.0, 1.0),
    noise: float = 0.3,
    dip_deg: float = 63.0,
    seconds: float = 60.0,
) -> list[Window]:
    """One window of a compass that is ``mounted`` otherwise than set (``now``), with errors in body axes."""
    random = np.random.default_rng(3)
    t = np.arange(0.0, seconds, 1.0 / HZ) - 0.5 * seconds
    roll, pitch = np.radians(tilt_deg) * np.sin(0.9 * t), np.radians(tilt_deg) * np.cos(0.61 * t)
    yaw = np.radians(turned_deg) * np.sin(2.0 * np.pi * t / seconds)
    earth = rotation.to_matrix(rotation.from_euler(roll, pitch, yaw + 0.7))
    power = 20.0 + 6.0 * np.sin(1.3 * t)
    h = 48.0 * np.array([np.cos(np.radians(dip_deg)), 0.0, np.sin(np.radians(dip_deg))])
    body = np.einsum("nia,i->na", earth, h) + np.array(offset) + power[:, None] * np.array(motors)
    body = (body + random.normal(0.0, noise, body.shape)) @ (
        np.eye(3) + iron * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
    )
    logged = body @ (mounting_matrix(now) @ mounting_matrix(mounted).T).T * np.array(mirror)
    drifted = rotation.to_matrix(rotation.from_euler(np.zeros(len(t)), np.zeros(len(t)), -np.radians(drift_dps) * t))
    return [Window(t, drifted @ earth, logged, power)]


def test_an_unsure_tilt_agrees_by_its_best_mounting() -> None:
    """A fault counts where the other tilt, sure or not, fits the same mounting best."""
    named = judged(windows(6))
    unsure = Orientation("unknown", "next", best=named.turn)
    assert orientation.joined([unsure, named]) is named
    for other in (Orientation("unknown", "world"), Orientation("unknown", "next", best=np.eye(3)), judged(windows())):
        assert orientation.joined([other, named]).verdict == "unknown"


def judged(made: list[Window], now: int = 0) -> Orientation:
    return orientation.judge(made, orientation.mounting_orders(now), EARTH)


@pytest.mark.parametrize(
    ("mounted", "now"), [(6, 0), (2, 0), (4, 0), (8, 0), (1, 0), (0, 6), (12, 4), (6, 8), (25, 14)]
)
def test_a_mounting_other_than_set_is_named_by_its_number(mounted: int, now: int) -> None:
    found = judged(windows(mounted, now), now)
    assert found.verdict == "fault"
    assert not found.mirrored
    number = orientation.mounting_number(found.turn, now)
    assert number is not None
    assert mounting_matrix(number) == pytest.approx(mounting_matrix(mounted), abs=1e-9)
    true = mounting_matrix(mounted) @ mounting_matrix(now).T
    angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(true) - 1.0), -1.0, 1.0)))
    assert found.angle_deg == pytest.approx(angle, abs=1.96 * found.sigma_deg)
    assert found.dip_deg[1] == pytest.approx(63.0, abs=5.0)


@pytest.mark.parametrize(
    "errors",
    [
        {"offset": (15.0, -20.0, 10.0)},
        {"motors": (0.6, -0.4, 0.8)},
        {"drift_dps": 0.7},
        {"offset": (-12.0, 8.0, 25.0), "motors": (0.3, 0.3, -0.2), "drift_dps": -0.4},
    ],
    ids=["offset", "motors", "drift", "all"],
)
def test_offset_motors_and_drift_neither_accuse_a_mounting_nor_hide_one(errors: dict) -> None:
    assert judged(windows(**errors)).verdict == "ok"
    found = judged(windows(6, **errors))
    assert found.verdict == "fault"
    assert orientation.mounting_number(found.turn, 0) == 6


def test_the_error_left_is_offset_and_motors_in_true_axes() -> None:
    found = judged(windows(6, offset=(5.0, -8.0, 3.0), noise=0.1))
    assert found.error.mean(axis=0) == pytest.approx([5.0, -8.0, 3.0], abs=0.8)
    assert len(found.error) == len(found.error_t)


@pytest.mark.parametrize(
    ("why", "made"),
    [
        ("data", {"turned_deg": 1.0}),
        ("data", {"seconds": 12.0}),
        ("tilt", {"tilt_deg": 0.3, "noise": 1.5}),
        ("iron", {"noise": 6.0}),
        ("world", {"dip_deg": -20.0}),
    ],
    ids=["no turn", "short", "level", "disturbed", "another dip"],
)
def test_what_a_flight_does_not_show_is_unknown_with_its_reason(why: str, made: dict) -> None:
    found = judged(windows(**made))
    assert (found.verdict, found.reason) == ("unknown", why)
    assert found.why


@pytest.mark.parametrize("askew_deg", [-15.0, 18.0, 28.0])
def test_a_compass_between_two_mountings_is_not_given_the_number_of_one(askew_deg: float) -> None:
    made = windows()
    turn = rotation.to_matrix(rotation.from_euler(0.0, 0.0, np.radians(askew_deg)))
    found = judged([Window(w.t, w.earth, w.field @ turn, w.power) for w in made])
    assert found.verdict != "fault"
    assert found.verdict == "ok" or found.reason == "askew"


def test_soft_iron_is_never_a_mounting() -> None:
    for iron in (0.1, 0.2, 0.3):
        assert judged(windows(iron=iron)).verdict != "fault"


@pytest.mark.parametrize(
    ("mirror", "said"), [((1, 1, -1), "z = -z"), ((-1, 1, 1), "x = -x"), ((-1, -1, -1), "x = -x, y = -y, z = -z")]
)
def test_mirrored_axes_are_no_mounting(mirror: tuple[float, float, float], said: str) -> None:
    found = judged(windows(mirror=mirror))
    assert (found.verdict, found.mirrored) == ("fault", True)
    assert orientation.mirrored_axes(found.turn) == said


def test_every_mounting_is_tried_once_and_the_present_one_first() -> None:
    orders = orientation.mounting_orders(6)
    assert orders[0] == pytest.approx(np.eye(3))
    apart = np.abs(orders[:, None] - orders[None]).max(axis=(2, 3))
    assert (apart[~np.eye(len(orders), dtype=bool)] > 1e-6).all()
    assert all(orientation.mounting_number(order, 6) is not None for order in orders)


@pytest.mark.parametrize(
    ("airborne", "crash_s", "used"),
    [
        ([(10.0, 11.5), (20.0, 80.0)], None, [(21.0, 79.0)]),
        ([(20.0, 80.0)], 50.0, [(21.0, 50.0)]),
        ([(10.0, 11.5), (20.0, 30.0)], None, [(-np.inf, 100.0)]),
    ],
    ids=["a hop has no middle", "nothing after a crash", "all of a short flight"],
)
def test_a_compass_is_judged_in_the_middle_of_flights(airborne: list, crash_s: float | None, used: list) -> None:
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("PX4"), "quadrotor")
    log.seconds = 100.0
    phases = [Segment("airborne", a, b) for a, b in airborne]
    phases += [Segment("impact", crash_s, crash_s + 0.1)] if crash_s else []
    assert use_spans(log, Segments(phases)) == used
