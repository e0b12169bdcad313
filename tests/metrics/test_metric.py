"""What metrics share of a case: computed once, for the right row, and gone with it."""

from __future__ import annotations

import gc
import json
import re
from typing import Any

import numpy as np
import pytest

from attlog import metrics
from attlog.core import rotation
from attlog.core.plain import to_plain
from attlog.flight.model import Imu, Stream
from attlog.metrics import accuracy, step_turning
from attlog.metrics.metric import CODES, Answer, Case, per_object, per_row
from attlog.metrics.rerun import AID_GROUPS
from attlog.metrics.traces import traces
from attlog.reference.model import Track
from attlog.segments.model import WINDOWS, Segment
from tests.conftest import ROOT
from tests.metrics import flights
from tests.metrics.flights import motion


@pytest.fixture
def calls() -> list[str]:
    return []


def row(name: str) -> Track:
    t = np.arange(0.0, 1.0, 0.1)
    return flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), name)


def test_rows_of_one_name_are_different_rows(calls: list[str]) -> None:
    """Two evaluations of one case may both hold a row ``mahony``."""

    @per_row
    def first(case: Case, row: Track, segment: slice) -> float:
        calls.append(row.name)
        return float(row.t[segment][0])

    a, b = row("mahony"), row("mahony")
    b.t = b.t + 5.0
    case = flights.case([a, b], [])
    assert [first(case, r, slice(0, 3)) for r in (a, b, a)] == [0.0, 5.0, 0.0]
    assert first(case, a, slice(2, 3)) == pytest.approx(0.2)
    assert len(calls) == 3


def test_what_was_found_for_a_row_goes_with_the_row() -> None:
    """A sweep evaluates thousands of rows on one case."""

    @per_row
    def size(case: Case, row: Track) -> int:
        return len(row.t)

    case, own = flights.case([], []), row("mahony")
    assert size(case, own) == 10
    assert len(case.of_row) == 1
    del own
    gc.collect()
    assert len(case.of_row) == 0


def test_what_rows_of_the_same_times_share_is_computed_once_for_each_array(calls: list[str]) -> None:
    @per_object
    def last(case: Case, t: np.ndarray, more: float = 0.0) -> float:
        calls.append("last")
        return float(t[-1]) + more

    case, t = flights.case([], []), np.arange(3.0)
    equal = t.copy()
    assert [last(case, t), last(case, t), last(case, t, more=1.0), last(case, equal)] == [2.0, 2.0, 3.0, 2.0]
    assert len(calls) == 3
    known = len(case.of_log)
    del equal
    gc.collect()
    assert len(case.of_log) == known - 1  # nothing is kept of an array that is gone


# What holds for every metric: names, units, evidence, and that heading has no origin.

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
    "total_rmse_deg heading_rmse_deg tilt_rmse_deg tilt_p95_deg "
    "noise_tilt_deg noise_roll_deg noise_pitch_deg noise_heading_deg "
    "lag_roll_ms lag_pitch_ms lag_yaw_ms lag_ms step_gain_roll distortion_roll_pct "
    "step_error_deg.0.5s step_error_pct.0.5s "
    "drift_rest_deg_per_min "
    "drift_air_deg_per_min.onboard drift_air_deg_per_min.course "
    "allan_arw_deg_per_sqrt_h allan_bias_deg_per_h gnss_heading_deg "
    "coverage_pct cost_ns tracking_rms_deg setpoint_delay_ms"
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
    for name, defined in known.items():
        suffix = next((s for s in sorted(UNITS, key=len, reverse=True) if re.search(rf"_{s}(\.|$)", name)), None)
        own = AID_GROUPS[name.partition(".")[2]].unit if name.startswith(("innovation_rms", "innovation_bias")) else "1"
        assert defined.unit == (UNITS[suffix] if suffix else own), name
        assert len(defined.definition) > 40
        assert "\n" not in defined.definition


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
            assert json.dumps(to_plain(answers), allow_nan=False)


def test_the_quick_and_quiet_filter_leads_where_it_should(case, table):
    marks = metrics.rank({n: {"all": t["all"]} for n, t in table.items()}, case.rows).best["all"]
    for column in ("noise_roll_deg", "noise_pitch_deg", "lag_ms", "lag_roll_ms", "tilt_rmse_deg", "total_rmse_deg"):
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


def test_traces_have_the_columns_that_the_figures_draw(case):
    columns = {
        "attitude": {"roll", "pitch", "heading"},
        "difference": {"total", "heading", "tilt", "roll", "pitch"},
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
    assert any(abs(float(onset) - event.onset) < 0.01 for event in step_turning.reference_steps(case))
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
    assert table["quick"]["all"]["tilt_rmse_deg"].coverage_pct == 45.0
    assert table["slow"]["all"]["tilt_rmse_deg"].coverage_pct is None
    assert metrics.rank(table, half.rows).best == {}
    quick.coverage_pct = 90.0
    assert metrics.rank(table, half.rows).best["all"]["tilt_rmse_deg"] == ["quick"]


def test_the_documentation_names_every_metric():
    text = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    for name in metrics.definitions():
        stem, dot, variant = name.partition(".")
        listed = any(f"{stem}.{of}" in text for of in ("HEADING_REFERENCE", "AID")) and variant in text
        assert f"`{name}`" in text or (bool(dot) and listed), name


# Once all rows have passed, headings are ranked and the cost is measured where it is wanted.


@pytest.mark.parametrize(
    ("cost", "only", "measured"),
    [
        (True, (), True),
        (False, (), False),
        (True, ("cost_ns",), True),
        (True, ("tilt_rmse_deg",), False),
        (False, ("cost_ns",), False),
    ],
)
def test_the_cost_is_measured_where_it_is_wanted(
    monkeypatch: pytest.MonkeyPatch, cost: bool, only: tuple[str, ...], measured: bool
) -> None:
    row_ = row("mahony")
    row_.ns_per_update = 5.0
    case = flights.case([row_], [Segment("continuous", 0, 10)])
    decided: list[Any] = []
    monkeypatch.setattr(accuracy, "rank_errors", decided.append)
    table = {"mahony": {"all": {"lag_ms": Answer(2.0)}}}
    metrics.finish(case, table, cost=cost, only=only)
    assert decided == [case]
    assert list(table["mahony"]["all"]) == ["lag_ms", *(["cost_ns"] if measured else [])]
