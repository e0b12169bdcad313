"""An onboard attitude that filters and force contradict is refused; a filter that is wrong refutes nobody."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.estimators.base import Estimate
from attlog.flight.model import Attitude, FlightLog, Gnss
from attlog.reference import Reference, ReferenceCheck, ReferenceOptions, Row, choose, contradicted
from attlog.reference.physics import contradiction
from attlog.segments import Segment, Segments

T = np.arange(0.0, 60.0, 0.02)
TURN = rotation.from_euler(0.3 * np.sin(0.8 * T), 0.3 * np.sin(0.5 * T), 0.2 * T)


def tilted(q: np.ndarray, deg: float) -> np.ndarray:
    lean = np.tile(rotation.from_euler(np.radians(deg), 0.0, 0.0), (len(q), 1))
    return rotation.multiply(lean, q)


def flight(onboard: np.ndarray, force: np.ndarray | None = None) -> FlightLog:
    from tests.segments.flights import imu_log

    earth = np.tile([0.0, 0.0, -9.80665], (len(T), 1)) if force is None else force
    log = imu_log(T, np.zeros((len(T), 3)), rotation.rotate_inverse(TURN, earth))
    log.attitudes, log.onboard = {"ATT": Attitude(T, onboard, "ATT")}, "ATT"
    return log


def rows(*attitudes: np.ndarray) -> list[Row]:
    zero = np.zeros(len(T), np.int64)
    return [Row(f"f{i}", "replay", T, q, zero, True, estimator=f"f{i}") for i, q in enumerate(attitudes)]


def refusal(log: FlightLog, filters: list[Row]) -> str:
    phases = segments.Segments([Segment("continuous", 0.0, 60.0)])
    found = contradicted(log, log.imus[0], choose(log, phases, ReferenceOptions()), filters)
    return "" if found is None else found[0]


def test_filters_that_agree_with_each_other_and_with_the_force_refuse_the_onboard_attitude() -> None:
    found = refusal(flight(tilted(TURN, 25.0)), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0)))
    assert "ATT is wrong by 25 deg: all filters agree" in found


def test_rows_that_have_passed_and_are_empty_refuse_it_as_well_and_one_is_run_again() -> None:
    log, phases = flight(tilted(TURN, 25.0)), segments.Segments([Segment("continuous", 0.0, 60.0)])
    whole = {row.name: row for row in rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0))}
    asked = []

    def again(row: Row) -> Row:
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


def test_one_wrong_filter_among_others_changes_nothing() -> None:
    assert refusal(flight(tilted(TURN, 25.0)), rows(TURN, TURN, TURN, tilted(TURN, 60.0)))


def test_two_filters_are_not_enough() -> None:
    assert refusal(flight(tilted(TURN, 25.0)), rows(TURN, TURN)) == ""


def test_filters_that_all_follow_an_acceleration_do_not_refute_an_attitude_that_the_force_confirms() -> None:
    leaning = tilted(TURN, 25.0)
    assert refusal(flight(TURN), rows(leaning, leaning, leaning)) == ""


def test_a_right_attitude_is_kept_whatever_single_filters_say() -> None:
    assert refusal(flight(TURN), rows(TURN, tilted(TURN, 20.0), tilted(TURN, -20.0))) == ""


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
        assert "wrong by 17 deg on the ground with motors on at" in found.fault


def test_one_quiet_time_alone_refuses_nothing() -> None:
    log = flight(np.where(((T > 30.0) & (T < 36.0))[:, None], tilted(TURN, 17.0), TURN))
    grounds = [(16.0, 20.0), (22.0, 26.0), (32.0, 35.0)]
    phases = Segments([Segment("continuous", 0.0, 60.0), *(Segment("idle", a, b) for a, b in grounds)])
    assert choose(log, phases).kind == "onboard"


def test_an_attitude_that_leans_to_both_sides_in_turn_is_not_refuted_by_a_mean_force_that_it_explains() -> None:
    """25 deg to the left and to the right for a second each: over a minute its mean force is gravity's to 0.9 m/s^2."""
    side = np.where((T % 2.0 < 1.0)[:, None], tilted(TURN, 25.0), tilted(TURN, -25.0))
    assert refusal(flight(side), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0))) == ""
    assert refusal(flight(tilted(TURN, 25.0)), rows(TURN, tilted(TURN, 2.0), tilted(TURN, -2.0)))


def named(q: dict[str, np.ndarray]) -> list[Row]:
    return [Row(name, "replay", T, x, np.zeros(len(T), np.int64), True, estimator=name) for name, x in q.items()]


@pytest.mark.parametrize(
    ("aids", "others", "refused"),
    [
        ("mag rest", (0.0, 0.5, -0.5), True),
        ("gnss mag", (0.0, 0.5, -0.5), False),  # filters without GNSS may all follow an acceleration
        ("mag rest", (0.0, 0.5), False),  # two models are not enough
        ("mag rest", (8.0, 7.5, 8.5), False),  # other models are with it
        ("mag rest", (0.0, 9.0, -9.0), False),  # they do not agree
    ],
)
def test_a_smoother_that_stands_with_the_filter_of_its_own_model_alone_is_no_reference(
    aids: str, others: tuple[float, ...], refused: bool
) -> None:
    from tests.reference.test_smoothed import made

    log, phases = flight(TURN), segments.Segments([segments.Segment("continuous", 0.0, 60.0)])
    smoother = made(off=Estimate(T, tilted(TURN, 8.0)), tilt=0.5, aided_by=aids)
    reference = choose(log, phases, smooth=lambda: smoother)
    assert reference.kind == "smoother"
    models = {f"f{k}": tilted(TURN, deg) for k, deg in enumerate(others)} | {"mekf": tilted(TURN, 8.0)}
    found = contradicted(log, log.imus[0], reference, named(models))
    assert (found is not None and "only mekf" in found[0]) is refused


def test_the_mean_force_of_a_vehicle_whose_imu_sits_tilted_is_gravity() -> None:
    """Attitudes are the vehicle's, ``q_imu (x) exp(-trim)``, forces the IMU's."""
    vector = np.radians([6.0, -4.0, 0.0])
    own, none = rotation.multiply(TURN, rotation.from_rotvec(-vector)), np.zeros(len(T), np.int64)
    reference = Reference("onboard", "ATT", T, own, none, none, trim=vector)
    force = contradiction._mean_force(flight(own).imus[0], reference, T, own, none, 10.0, 50.0)
    assert force == pytest.approx([0.0, 0.0, -9.80665], abs=1e-6)


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
