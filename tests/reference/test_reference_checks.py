"""Does the accelerometer in quiet time contradict a reference?"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Gnss, Imu, Stream
from attlog.reference import Reference, ReferenceCheck, ReferenceOptions, Track, alignment, choose, onboard_check
from attlog.reference.model import Alignment
from attlog.reference.reference_checks import (
    GRAVITY_M_S2,
    QuietSegment,
    StaticTilt,
    _intermittent_fault,
    gravity_check,
    static_tilt_refusal,
)
from attlog.reference.reference_checks import static_tilt as residuals_of
from attlog.segments import Segment, Segments
from tests.reference.flights import attitude_at, contradicted
from tests.reference.flights import flight as flights_flight

REFERENCE: Any = SimpleNamespace(t=np.array([0.0, 100.0]), source="ATT")


def quiet(begin: float, tilt: float, force: float = GRAVITY_M_S2) -> QuietSegment:
    return QuietSegment("rest", begin, 5.0, tilt, force)


@pytest.mark.parametrize(
    ("wrong", "refused"),
    [
        ([quiet(20.0, 30.0), quiet(50.0, 14.0)], True),
        ([quiet(2.0, 30.0), quiet(50.0, 14.0)], False),  # it may not be aligned yet
        ([quiet(20.0, 30.0, GRAVITY_M_S2 + 0.6), quiet(50.0, 14.0)], False),  # the force is not gravity alone
        ([quiet(20.0, 9.0), quiet(50.0, 14.0)], False),
    ],
)
def test_two_quiet_times_with_gravity_alone_after_the_alignment_refuse_an_attitude(
    wrong: list[QuietSegment], refused: bool
) -> None:
    found = _intermittent_fault(REFERENCE, [*wrong, quiet(70.0, 1.0), quiet(80.0, 1.0)])
    assert bool(found) is refused
    if refused:
        assert found.startswith("ATT is wrong by 30 deg at rest at 20 s")


def test_the_trim_of_a_reference_is_put_back_before_gravity_in_the_imus_axes_judges_it() -> None:
    """The IMU stands 8 deg rolled and the reference has that taken out: both are right, neither is 16 deg off."""
    t, roll = np.arange(0.0, 20.0, 0.05), np.radians([8.0, 0.0, 0.0])
    own = np.tile(rotation.from_rotvec(roll), (len(t), 1))
    force = rotation.rotate_inverse(own, np.tile([0.0, 0.0, -GRAVITY_M_S2], (len(t), 1)))
    unit = Imu(0, Stream(t, np.zeros_like(force), "rad/s", "FRD", "IMU"), Stream(t, force, "m/s^2", "FRD", "IMU"))
    vehicle: Any = SimpleNamespace(
        kind="onboard",
        t=t,
        q=alignment.apply_trim(own, roll),
        segment=np.zeros(len(t), np.int64),
        alignment=Alignment(trim=roll),
        source="ATT",
    )
    fault, (step,) = gravity_check(vehicle, unit, Segments([Segment("rest.long", 0.0, 20.0)]))
    assert fault == ""
    assert step.value == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("stepped", "refused"), [("accelerometer", False), ("attitude", True)])
def test_gravity_after_a_flight_refuses_an_attitude_that_turned_otherwise_than_the_gyro(
    stepped: str, refused: bool
) -> None:
    """Rest to 18 s, then turns; twice at rest from 50 s on. Accelerometer or attitude tilts by 20 deg at 30 s."""
    log = flights_flight(80.0)
    unit, onboard = log.imus[0], log.attitudes["ATT"]
    if stepped == "accelerometer":
        tilt = rotation.from_euler(np.radians(20.0), 0.0, 0.0)
        unit.acc.x = np.where((unit.acc.t >= 30.0)[:, None], rotation.rotate(tilt, unit.acc.x), unit.acc.x)
    else:
        onboard.q = np.where((onboard.t >= 30.0)[:, None], tilted(onboard.q, 20.0), onboard.q)
    quiet = [Segment("rest.long", 1.0, 18.0), Segment("hover", 50.0, 60.0), Segment("hover", 65.0, 78.0)]
    quiet += [Segment("rest.long", 50.0, 60.0), Segment("rest.long", 65.0, 78.0)]
    phases = Segments([Segment("continuous", 0.0, 80.0), *quiet])
    found = choose(log, phases, ReferenceOptions())
    assert ("onboard" in found.faults.refused) is refused


# Where the vehicle stands still, gravity says who is tilted, the judge or the accused.


def residuals(judge: float, accused: float, sigma: float = 0.5, begin: float = 10.0) -> StaticTilt:
    """Ten still windows from ``begin`` s on with these residuals in deg."""
    start = begin + 0.5 * np.arange(10)
    each = np.ones(10)
    return StaticTilt(np.column_stack([start, start + 2.0]), judge * each, accused * each, sigma * each)


@pytest.mark.parametrize(
    ("judge", "accused", "acquitted"),
    [
        (8.4, 1.05, True),  # the judge is the wrong one
        (0.1, 2.4, True),  # an accelerometer bias explains it
        (0.1, 6.0, False),
        (7.0, 6.0, True),  # both are off, the judge by more
    ],
)
def test_nobody_is_accused_of_tilt_against_gravity(judge: float, accused: float, acquitted: bool) -> None:
    assert residuals(judge, accused).supports_onboard((11.0, 15.0)) is acquitted


@pytest.mark.parametrize(
    ("judge", "accused", "sigma", "refused"),
    [
        (2.4, 0.8, 0.9, True),  # twice the other's
        (2.4, 1.5, 0.9, False),
        (4.0, 3.5, 0.2, True),  # above 3 sigmas with 1 deg of the accelerometer's own
        (4.0, 3.5, 1.2, False),
        (1.9, 0.1, 0.1, False),
        (4.0, np.nan, 0.2, True),
    ],
)
def test_gravity_refuses_a_judge_that_is_further_off_than_it_says(
    judge: float, accused: float, sigma: float, refused: bool
) -> None:
    assert bool(residuals(judge, accused, sigma).contradicting()) is refused


@pytest.mark.parametrize(("sigma", "refused"), [(0.02, False), (0.2, True)])
def test_a_bias_that_motion_shows_does_not_refuse_the_judge(sigma: float, refused: bool) -> None:
    """The accelerometer reads 0.7 m/s^2 too much along y: gravity seems 4 deg off."""
    log, judge = flights_flight(), judge_over(60.0)
    log.imus[0].acc.x = log.imus[0].acc.x + np.array([0.0, 0.7, 0.0])
    values = {"x": 0.0, "y": 0.7, "z": 0.0}
    judge.quality = {"heading_from": "motion"} | {f"acc_bias_{k}_m_s2": v for k, v in values.items()}
    judge.quality |= {f"acc_bias_{k}_sigma_m_s2": sigma for k in values}
    found = residuals_of(log, judge, Attitude(judge.t, judge.q, "ATT"))
    assert found is not None
    assert np.nanmedian(found.reference) == pytest.approx(4.0, abs=0.3)
    assert bool(found.contradicting()) is refused


def judge_over(seconds: float) -> Reference:
    """A smoother without gaps."""
    t = np.arange(0.0, seconds, 0.1)
    none = np.zeros(len(t), np.int64)
    return Reference("smoother", "made", t, attitude_at(t), none, none)


def test_a_judge_is_refused_throughout_where_little_else_is_known_of_it() -> None:
    """Off gravity from 10 to 16.5 s: a third of 20 s, but little of 100 s."""
    found = residuals(8.0, 1.0)
    why, refused = static_tilt_refusal(found, judge_over(20.0), "ATT")
    assert why == "standing still from 10 to 16 s it is 8.0 deg off gravity (sigma 0.5), ATT 1.0 deg"
    assert refused == [(0.0, pytest.approx(19.9))]
    assert static_tilt_refusal(found, judge_over(100.0), "ATT") == ("", [(10.0, 16.5)])


def test_the_trim_of_vehicle_and_judge_is_no_residual() -> None:
    """Both are attitudes of a vehicle in which the IMU sits tilted: ``q_imu (x) exp(-trim)``."""
    log, judge, vector = flights_flight(), judge_over(60.0), np.radians([4.0, -3.0, 0.0])
    mount = rotation.from_rotvec(-vector)
    judge.q, judge.alignment.trim, log.parameters.trim = rotation.multiply(judge.q, mount), vector, vector
    onboard = Attitude(judge.t, judge.q, "ATT", has_trim=True)
    found = residuals_of(log, judge, onboard)
    assert found is not None
    assert found.reference == pytest.approx(0.0, abs=0.2)
    assert found.onboard == pytest.approx(0.0, abs=0.2)


# An onboard attitude that filters and force contradict is refused; a filter that is wrong refutes nobody.

T = np.arange(0.0, 60.0, 0.02)
TURN = rotation.from_euler(0.3 * np.sin(0.8 * T), 0.3 * np.sin(0.5 * T), 0.2 * T)


def tilted(q: np.ndarray, deg: float) -> np.ndarray:
    lean = np.tile(rotation.from_euler(np.radians(deg), 0.0, 0.0), (len(q), 1))
    return rotation.multiply(lean, q)


def flight(onboard: np.ndarray, force: np.ndarray | None = None) -> FlightLog:
    from tests.segments.flights import imu_log

    earth = np.tile([0.0, 0.0, -9.80665], (len(T), 1)) if force is None else force
    rate = rotation.relative_rotvecs(TURN[:-1], TURN[1:]) / np.diff(T)[:, None]
    log = imu_log(T, np.concatenate([rate, rate[-1:]]), rotation.rotate_inverse(TURN, earth))
    log.attitudes, log.onboard = {"ATT": Attitude(T, onboard, "ATT")}, "ATT"
    return log


def rows(*attitudes: np.ndarray) -> list[Track]:
    zero = np.zeros(len(T), np.int64)
    return [Track(f"f{i}", "replay", T, q, zero, True, estimator=f"f{i}") for i, q in enumerate(attitudes)]


def refusal(log: FlightLog, filters: list[Track]) -> str:
    phases = segments.Segments([Segment("continuous", 0.0, 60.0)])
    found = contradicted(log, log.imus[0], choose(log, phases, ReferenceOptions()), filters)
    return "" if found is None else found[0]


def test_filters_that_agree_with_each_other_and_with_the_force_refuse_the_onboard_attitude() -> None:
    found = refusal(flight(tilted(TURN, 25.0)), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0)))
    assert "ATT is wrong by 25 deg: all filters agree" in found


def test_only_a_reference_whose_mean_force_is_not_gravity_can_be_refused() -> None:
    phases = segments.Segments([Segment("continuous", 0.0, 60.0)])
    wrong_for_a_while = np.where(((T >= 31.3) & (T < 43.7))[:, None], tilted(TURN, 25.0), TURN)
    for onboard, choice, expected in (
        (tilted(TURN, 25.0), "auto", True),
        (tilted(TURN, 25.0), "onboard", False),
        (tilted(TURN, 2.0), "auto", False),
        (wrong_for_a_while, "auto", True),
    ):
        log = flight(onboard)
        chosen = choose(log, phases, ReferenceOptions())
        assert ReferenceCheck(log, log.imus[0], chosen, lambda row: row, choice).may_refuse() == expected


def test_rows_that_have_passed_and_are_empty_refuse_it_as_well_and_one_is_run_again() -> None:
    log, phases = flight(tilted(TURN, 25.0)), segments.Segments([Segment("continuous", 0.0, 60.0)])
    whole = {row.name: row for row in rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0))}
    asked = []

    def again(row: Track) -> Track:
        asked.append(row.name)
        return whole[row.name]

    check = ReferenceCheck(log, log.imus[0], choose(log, phases, ReferenceOptions()), again)
    for row in rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0)):
        check.add(row)
        row.release()
    assert asked == []
    found = check.contradicted()
    assert found is not None
    assert asked == ["f0"]
    assert found == contradicted(log, log.imus[0], choose(log, phases, ReferenceOptions()), list(whole.values()))


def test_filters_on_an_accelerometer_with_exchanged_axes_are_one_witness() -> None:
    """The vehicle leans by 25 deg to one side after the other; x and y are exchanged, as all filters see it."""
    side = (T // 6.0).astype(int) % 4
    roll, pitch = np.radians(25.0) * np.array([[1, 0, -1, 0], [0, 1, 0, -1]])[:, side]
    own = rotation.from_euler(roll, pitch, 0.0 * T)
    log = flight(own)
    force = rotation.rotate_inverse(own, np.tile([0.0, 0.0, -9.80665], (len(T), 1)))[:, [1, 0, 2]]
    log.imus[0].acc.x = force
    seen = rotation.from_euler(np.arctan2(-force[:, 1], -force[:, 2]), np.arcsin(force[:, 0] / 9.80665), 0.0 * T)
    assert refusal(log, rows(seen, tilted(seen, 2.0), tilted(seen, -2.0))) == ""
    log.imus[0].acc.x = rotation.rotate_inverse(own, np.tile([0.0, 0.0, -9.80665], (len(T), 1)))
    log.attitudes["ATT"].q = tilted(own, 25.0)
    assert "wrong by 25 deg" in refusal(log, rows(own, tilted(own, 2.0), tilted(own, -2.0)))


def test_two_filters_are_not_enough() -> None:
    assert refusal(flight(tilted(TURN, 25.0)), rows(TURN, TURN)) == ""


def test_filters_that_all_follow_an_acceleration_do_not_refute_an_attitude_that_the_force_confirms() -> None:
    leaning = tilted(TURN, 25.0)
    assert refusal(flight(TURN), rows(leaning, leaning, leaning)) == ""


def test_a_strong_push_is_not_taken_for_gravity() -> None:
    """4.6 m/s^2 tilt what follows the force by 25 deg, but the force is larger than gravity then."""
    log = flight(TURN, np.tile([0.0, -4.573, -9.80665], (len(T), 1)))
    leaning = tilted(TURN, 25.0)
    assert refusal(log, rows(leaning, leaning, leaning)) == ""


@pytest.mark.parametrize(
    ("begin", "end", "fix", "known"),
    [(0.0, 60.0, 3, True), (0.0, 0.0, 3, False), (0.0, 60.0, 2, False), (0.0, 40.0, 3, False), (20.0, 60.0, 3, False)],
    ids=["known", "no receiver", "no 3D fix", "ends early", "begins late"],
)
def test_a_weak_push_is_told_from_a_wrong_attitude_by_gnss(begin: float, end: float, fix: int, known: bool) -> None:
    """3.2 m/s^2 tilt the force by 18 deg and hardly enlarge it: only the change of velocity tells."""
    push = np.array([0.0, -3.2, 0.0])
    log = flight(TURN, np.tile([0.0, -3.2, -9.80665], (len(T), 1)))
    t = np.arange(begin, end, 0.2)
    nothing = np.full(len(t), np.nan)
    velocity = t[:, None] * push
    log.gnss = [
        Gnss(0, t, "gnss", nothing, nothing, nothing, velocity, nothing, nothing, nothing, np.full(len(t), fix))
    ]
    leaning = tilted(TURN, 18.07)
    assert bool(refusal(log, rows(leaning, leaning, leaning))) != known


@pytest.mark.parametrize(("tilt", "refused"), [(17.0, True), (5.0, False)])
def test_quiet_time_on_the_ground_refuses_an_attitude_that_is_wrong_there_only(tilt: float, refused: bool) -> None:
    wrong = np.where(((T > 30.0) & (T < 45.0))[:, None], tilted(TURN, tilt), TURN)
    log = flight(wrong)
    grounds = [(16.0, 20.0), (22.0, 26.0), (32.0, 35.0), (38.0, 41.0)]
    phases = Segments([Segment("continuous", 0.0, 60.0), *(Segment("idle", a, b) for a, b in grounds)])
    found = choose(log, phases)
    assert (found.kind == "none") == refused
    if refused:
        assert "wrong by 17 deg on the ground with motors on at" in found.faults.reference


def test_an_attitude_that_leans_to_both_sides_in_turn_is_not_refuted_by_a_mean_force_that_it_explains() -> None:
    """25 deg to the left and to the right for a second each: over a minute its mean force is gravity's to 0.9 m/s^2."""
    side = np.where((T % 2.0 < 1.0)[:, None], tilted(TURN, 25.0), tilted(TURN, -25.0))
    assert refusal(flight(side), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0))) == ""
    assert refusal(flight(tilted(TURN, 25.0)), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0)))


def test_the_longest_time_of_a_contradiction_is_the_one_that_is_told() -> None:
    """By 20 deg from 16 to 26 s, and by 35 deg from 30 to 55 s."""
    size = np.where((T >= 16.0) & (T < 26.0), 20.0, np.where((T >= 30.0) & (T < 55.0), 35.0, 0.0))
    lean = rotation.from_euler(np.radians(size), 0.0 * T, 0.0 * T)
    log, phases = flight(rotation.multiply(lean, TURN)), segments.Segments([Segment("continuous", 0.0, 60.0)])
    filters = rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0))
    found = contradicted(log, log.imus[0], choose(log, phases, ReferenceOptions()), filters)
    assert found is not None
    assert "is wrong by 35 deg" in found[0]
    assert "from 30." in found[1].text


# When an onboard attitude is judged at all.


def test_an_onboard_attitude_is_not_judged_before_it_is_aligned(monkeypatch: pytest.MonkeyPatch) -> None:
    log = flights_flight()
    log.truth = replace(log.attitudes["ATT"])
    found = segments.build(log)
    judge = choose(log, found, ReferenceOptions(declination=0.0))
    assert judge.kind == "truth"
    for aligned in (None, judge.scoring.start + 7.0):
        monkeypatch.setattr(onboard_check.scoring, "aligned_at", lambda *_, at=aligned: at)
        compared = onboard_check.compare_onboard(log, found, judge)
        assert compared is not None
        begin = float(compared.t[np.argmax(compared.counted)])
        assert begin == pytest.approx(judge.scoring.start if aligned is None else aligned, abs=0.1)
