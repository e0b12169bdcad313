"""Phases of real logs on which a report once said something false; each truth was found by hand, with other tools."""

from __future__ import annotations

from pathlib import Path

import pytest

import attlog
from attlog import segments
from attlog.analysis.summary import describe
from attlog.flight.model import PAUSE_S
from attlog.segments import Segments, spans


@pytest.fixture(scope="module")
def cases() -> Path:
    """The folder of these logs."""
    from tests.conftest import corpus_root

    root = corpus_root()
    if root is None or not (root / "logs" / "cases").is_dir():
        pytest.skip("ATTLOG_CORPUS does not name a folder with logs/cases")
    return root / "logs" / "cases"


def phases(path: Path) -> Segments:
    """The segments of a log."""
    return segments.build(attlog.read(path))


def test_land_complete_maybe_ends_no_flight_and_a_crash_between_flights_is_told(cases):
    """Throttle above half and height above 0.5 m for 208 s; a crash at 165.7 s, 174 deg of tilt, flown on later."""
    found = phases(cases / "copter_3.3dev_118.BIN")
    assert found.seconds("airborne") == pytest.approx(208, abs=12)
    lost = [s for s in found.of("loss_of_control") if s.t0 < 200]
    assert [s.t0 for s in lost] == [pytest.approx(165.7, abs=0.2)]
    assert "4.6 g" in lost[0].why
    assert "turned over to 172 deg" in lost[0].why
    assert all(s.t0 > 300 for s in found.of("impact"))


def test_a_tipped_copter_and_a_pause_of_the_logger_are_no_flight(cases):
    """About 32 s of flight; the land detector's span covers a pause of 59 s and the copter lying at 45 and 178 deg."""
    found = phases(cases / "copter_3.3dev_37.BIN")
    assert found.seconds("airborne") == pytest.approx(32, abs=7)
    assert spans.intersect(found.spans("airborne"), [(28.0, 102.0), (121.5, 157.5)]) == []


def test_a_blow_that_is_followed_by_further_flights_drops_none_of_them(cases):
    """219 s of flight after a bounce at 138 s; ATT roll stayed within -15 to -1 deg, there was no tumble."""
    found = phases(cases / "copter_3.3dev_31.BIN")
    assert found.of("impact") == []
    assert not [s for s in found.of("loss_of_control") if 130 < s.t0 < 145]
    assert spans.seconds(spans.intersect(found.spans("airborne"), [(140, 530)])) == pytest.approx(219, abs=10)


def test_a_hover_as_still_as_a_table_is_no_rest(cases):
    """Simulated without vibration: 1.97 m above the ground with motors at 1595 us, and no record of arming."""
    found = phases(cases / "copter_4.4dev_sitl_swarm.BIN")
    assert spans.intersect(found.spans("rest"), [(4.0, 80.0)]) == []
    assert spans.seconds(spans.intersect(found.spans("hover"), [(6.0, 79.0)])) > 70


def test_a_steady_climb_is_no_rest(cases):
    found = phases(cases / "copter_4.7dev_sitl_climb.BIN")
    assert spans.intersect(found.spans("rest"), [(4.0, 28.0)]) == []
    assert found.spans("airborne")[0] == (pytest.approx(3.2, abs=0.5), pytest.approx(27.5, abs=0.1))


def test_full_throttle_without_height_is_no_flight_and_stopped_motors_are_rest_though_armed(cases):
    """A bench run: the altitude moves under 0.5 m; afterwards 14.6 s still with all outputs at minimum."""
    found = phases(cases / "copter_3.2.1_bench.log")
    assert found.of("airborne") == []
    assert found.of("hover") == []
    assert found.seconds("rest") == pytest.approx(14.6, abs=2.0)
    assert spans.seconds(spans.intersect(found.spans("idle"), [(3.0, 33.5)])) > 28


def test_a_slow_telemetry_imu_still_shows_rest(cases):
    """Disarmed and still from 30 to 440 s; at 1.2 Hz nothing can be replayed, but standing still can be seen."""
    found = phases(cases / "copter_3.5.7_radio.tlog")
    assert spans.seconds(spans.intersect(found.spans("rest"), [(30.0, 440.0)])) > 250
    assert spans.intersect(found.spans("rest"), found.spans("airborne")) == []


def test_a_board_on_the_bench_rests_throughout_and_one_turned_by_hand_never(cases):
    assert phases(cases / "px4_1.6.5_bench.ulg").seconds("rest") == pytest.approx(22.9, abs=1.0)
    assert phases(cases / "px4_1.6.5_hand_rotation.ulg").seconds("rest") == 0.0


def test_unknown_arming_is_not_zero_seconds_of_it(cases):
    log = attlog.read(cases / "copter_4.4dev_sitl_swarm.BIN")
    assert describe(log, segments.build(log))["seconds"]["armed"] is None


@pytest.mark.slow
def test_no_span_runs_through_a_pause_of_the_logger(cases):
    for path in (p for p in sorted(cases.iterdir()) if p.suffix.lower() in (".bin", ".log", ".ulg")):
        found = phases(path)
        pauses = [(s.t0 + 0.1, s.t1 - 0.1) for s in found.of("gap") if s.seconds > PAUSE_S]
        for kind in ("rest", "idle", "armed", "airborne", "hover", "cruise"):
            assert spans.intersect(found.spans(kind), pauses) == [], (path.name, kind)
