"""What holds for every metric: names, units, evidence, and that heading has no origin."""

import json
import re

import numpy as np
import pytest

from attlog import metrics
from attlog.base import rotation
from attlog.base.plain import plain
from attlog.flight.model import Imu, Stream
from attlog.metrics.answer import CODES
from attlog.metrics.figures.traces import traces
from attlog.metrics.steps import events as steps
from attlog.segments.model import WINDOWS, Segment
from tests.conftest import ROOT
from tests.metrics import flights
from tests.metrics.motions import motion

UNITS = {
    "deg": "deg",
    "ms": "ms",
    "pct": "%",
    "s": "s",
    "deg_per_min": "deg/min",
    "deg_per_sqrt_h": "deg/sqrt(h)",
    "deg_per_h": "deg/h",
    "dps": "deg/s",
    "ns": "ns",
    "per_s": "1/s",
}
NAMED = (
    "total_rmse_deg heading_median_deg inclination_p95_deg total_max_deg "
    "noise_tilt_deg noise_roll_deg noise_pitch_deg noise_heading_deg noise_p2p_deg "
    "lag_roll_ms lag_pitch_ms lag_yaw_ms lag_ms step_gain_roll distortion_roll_pct "
    "step_error_deg.0.5s step_error_deg.1.0s step_error_pct.0.5s step_error_pct.1.0s leak_per_s "
    "overshoot_pct settling_s drift_rest_deg_per_min "
    "drift_air_deg_per_min.onboard drift_air_deg_per_min.course wander_deg "
    "allan_arw_deg_per_sqrt_h allan_bias_deg_per_h convergence_s recovery_s hover_jitter_deg gyro_bias_error_dps "
    "coverage_pct replay_floor_deg cost_ns cost_ratio tracking_rms_deg setpoint_delay_ms"
).split()


def made_up(turn=0.0, seed=0):
    """72 s of rest, then 60 s of steps, two filters with different noise and lag; everything turned by ``turn`` rad."""
    t, q = motion("steps", 60.0)
    t, q = np.concatenate([np.arange(0.0, 72.0, 0.0025), t + 72.0]), np.concatenate([np.tile(q[0], (28800, 1)), q])
    at = t[::2]
    rng = np.random.default_rng(seed)
    rows = []
    for name, sigma, delay in (("quick", 1e-4, 0.0), ("slow", 5e-4, 0.03)):
        wobble = rotation.from_rotvec(sigma * rng.standard_normal((len(at), 3)))
        own = rotation.slerp(t, q, np.maximum(at - delay, 0.0))
        rows.append(
            flights.row(at, rotation.turn_about_down(rotation.multiply(own, wobble), turn), name, ns_per_update=50.0)
        )
    rows[1].bias = np.zeros((len(at), 3)) + 1e-3
    segments = [
        Segment("continuous", 0, 132),
        Segment("rest.long", 0, 71),
        Segment("airborne", 74, 131),
        Segment("armed", 72, 132),
        Segment("hover", 74, 82),
        Segment("cruise", 82, 131),
        Segment("idle", 71, 73),
    ]
    reference = t[::16], rotation.turn_about_down(q, turn)[::16]
    case = flights.case(rows, segments, reference, scoring_start=15.0)
    gyro = Stream(at, 1e-3 * rng.standard_normal((len(at), 3)), "rad/s", "FRD", "imu")
    acc = Stream(at, np.tile([0.0, 0.0, -9.81], (len(at), 1)), "m/s^2", "FRD", "imu")
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    return case


@pytest.fixture(scope="module")
def case():
    return made_up()


@pytest.fixture(scope="module")
def table(case):
    return {row.name: metrics.compute(case, row, [*WINDOWS, "75:100"]) for row in case.rows}


def test_the_names_that_users_rely_on_are_defined_and_carry_their_unit():
    known = metrics.definitions()
    assert not set(NAMED) - known.keys()
    for name, metric in known.items():
        suffix = next((s for s in sorted(UNITS, key=len, reverse=True) if re.search(rf"_{s}(\.|$)", name)), None)
        assert metric.unit == (UNITS[suffix] if suffix else "1"), name
        assert len(metric.definition) > 40
        assert "\n" not in metric.definition


def test_every_value_has_its_evidence_and_every_absence_its_reason(table):
    known = metrics.definitions()
    for by_window in table.values():
        for window, answers in by_window.items():
            for name, answer in answers.items():
                assert answer.unit == known[name].unit
                assert answer.window == window
                if answer.value is None:
                    assert answer.code in CODES
                    assert len(answer.reason.split()) > 3
                    continue
                assert np.isfinite(answer.value)
                assert answer.n >= 1
                assert answer.seconds > 0
                assert answer.method
                if answer.ci95 is None:
                    assert not answer.ranked
                    assert answer.reason
                else:
                    assert answer.ci95[0] <= answer.value <= answer.ci95[1], name
            assert json.dumps(plain(answers), allow_nan=False)


def test_the_quick_and_quiet_filter_leads_where_it_should(case, table):
    marks = metrics.rank({n: {"all": t["all"]} for n, t in table.items()}, case.rows).best["all"]
    for column in (
        "noise_roll_deg",
        "noise_pitch_deg",
        "lag_ms",
        "lag_roll_ms",
        "inclination_rmse_deg",
        "total_rmse_deg",
    ):
        assert marks[column] == ["quick"], column
    assert table["slow"]["all"]["lag_ms"].value == pytest.approx(30.0, abs=1.0)


def test_every_number_is_the_same_whatever_the_heading(table):
    turned = made_up(turn=2.0)
    for row in turned.rows:
        for window, answers in metrics.compute(turned, row, ["all", "airborne", "rest"]).items():
            for name, answer in answers.items():
                was = table[row.name][window][name]
                assert answer.code == was.code, name
                if answer.value is not None:
                    assert answer.value == pytest.approx(was.value, rel=1e-5, abs=1e-7), name


def test_the_same_log_gives_the_same_numbers(table):
    again = made_up()
    assert {r.name: plain(metrics.compute(again, r, ["all"])["all"]) for r in again.rows} == {
        name: plain(t["all"]) for name, t in table.items()
    }


def test_traces_have_the_columns_that_the_figures_draw(case):
    columns = {
        "attitude": {"roll", "pitch", "heading"},
        "difference": {"total", "heading", "inclination", "roll", "pitch"},
        "rest": {"roll", "pitch", "heading"},
        "drift": {"heading", "line"},
        "allan": {"tau", "deviation", "low", "high"},
        "step": {"est", "ref"},
        "steps": {"median", "low", "high", "ref"},
        "spread": {"angle", "share"},
        "bias": {"x", "y", "z"},
    }
    found = traces(case, case.rows)
    for trace in found:
        if trace.figure in columns:
            assert set(trace.columns) == columns[trace.figure]
        assert all(len(c) == len(trace.t) for c in trace.columns.values())
    assert {t.figure for t in found} >= columns.keys()
    assert [t.row for t in found if t.figure == "attitude"] == ["truth", "quick", "slow"]
    step = next(t for t in found if t.figure == "step")
    axis, _, onset = step.key.partition("@")
    assert axis in ("roll", "pitch", "yaw")
    assert any(abs(float(onset) - event.onset) < 0.01 for event in steps.of_reference(case))
    assert step.columns["ref"][-1] > step.columns["ref"][0]
    np.testing.assert_allclose(step.columns["est"], step.columns["ref"], atol=0.5)


def test_a_log_with_nothing_in_it_gives_codes_only():
    t = np.arange(0.0, 1.0, 0.01)
    row = flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    empty = flights.case([row], [])
    answers = metrics.compute(empty, row, WINDOWS)["all"]
    assert all(a.value is None for a in answers.values())
    assert len(traces(empty, [row])) == 1
    nothing = flights.row(np.zeros(0), np.zeros((0, 4)))
    assert all(a.value is None for a in metrics.compute(flights.case([nothing], []), nothing, ["all"])["all"].values())


def test_a_filter_that_turned_nan_breaks_nothing(case):
    broken = made_up()
    row = broken.rows[0]
    row.q[len(row.q) // 2 :] = np.nan
    row.status = "diverged"
    good = np.isfinite(row.q).all(axis=1)
    row.errors = flights.errors(flights.row(row.t[good], row.q[good]), broken.reference)
    table = {r.name: metrics.compute(broken, r, ["all", "rest", "airborne"]) for r in broken.rows}
    marks = metrics.rank(table, broken.rows)
    assert all("quick" not in names for columns in marks.ranked.values() for names in columns.values())
    assert traces(broken, broken.rows)


def test_a_filter_scored_on_its_good_half_says_so_and_is_not_best():
    half = made_up()
    quick = half.rows[0]
    quick.coverage_pct = 45.0
    table = {r.name: metrics.compute(half, r, ["all"]) for r in half.rows}
    assert table["quick"]["all"]["inclination_rmse_deg"].coverage_pct == 45.0
    assert table["slow"]["all"]["inclination_rmse_deg"].coverage_pct is None
    assert metrics.rank(table, half.rows).best == {}
    quick.coverage_pct = 90.0
    assert metrics.rank(table, half.rows).best["all"]["inclination_rmse_deg"] == ["quick"]


def test_the_documentation_names_every_metric():
    text = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    for name in metrics.definitions():
        stem, dot, heading_reference = name.partition(".")
        stands = f"{stem}.HEADING_REFERENCE" in text and heading_reference in text
        known = f"`{name}`" in text or (bool(dot) and stands)
        statistic = next((s for s in ("_median_", "_p95_", "_max_") if s in name), None)
        assert known or (statistic and f"`{statistic}`" in text and f"`{name.replace(statistic, '_rmse_')}`" in text), (
            name
        )
