"""Whatever a log lacks, the page says so in words and shows the rest."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.metric import missing
from attlog.metrics.trace import Trace, envelope
from attlog.report import write_report
from attlog.result import Result
from attlog.words.answers import verdicts
from attlog.words.table import main_table
from tests.report.browser import own_bytes
from tests.report.conftest import make_result

MANY = tuple(f"filter{i}@preset-with-a-long-name" for i in range(20))


def without_rest() -> Result:
    result = make_result()
    result.traces = [t for t in result.traces if t.figure not in ("rest", "allan") and t.key != "rest"]
    result.segments = [s for s in result.segments if not s.kind.startswith("rest")]
    for row in result.estimators:
        row.metrics["rest"] = {
            m: missing("no_rest", "The log holds no rest with the motors off.", a.unit, "rest")
            for m, a in row.metrics["rest"].items()
        }
    return result


def without_magnetometer() -> Result:
    result = make_result()
    result.log["mag"] = None
    for row in result.estimators:
        row.uses_mag = False
        for answers in row.metrics.values():
            for metric, answer in answers.items():
                if "heading" in metric or "drift" in metric:
                    answers[metric] = missing(
                        "no_magnetometer", "the log holds no magnetometer", answer.unit, answer.window
                    )
    return result


def one_sample() -> Result:
    result = make_result(with_traces=False)
    one = np.array([0.0])
    result.traces = [
        Trace("attitude", r.name, one, {a: one for a in ("roll", "pitch", "heading")}) for r in result.estimators
    ]
    result.log |= {"duration_s": 0.0, "seconds": None, "imu": None, "mag": None, "attitude": None}
    result.segments, result.best = [], {}
    for row in result.estimators:
        row.metrics = {"all": {"total_rmse_deg": missing("record_too_short", "one sample", "deg", "all")}}
    return result


def without_reference() -> Result:
    result = make_result()
    result.reference = None
    result.estimators = [r for r in result.estimators if r.kind == "replay"]
    result.traces = [t for t in result.traces if t.figure in ("attitude", "rest") and t.row != "onboard"]
    return result


def none_converged() -> Result:
    result = make_result()
    for row in result.estimators[1:]:
        row.status, row.reason = "not_converged", "had not settled 60 s after its start"
    result.best = {}
    return result


def nothing_at_all() -> Result:
    empty = Result({}, "", {}, {})
    return empty


def twenty() -> Result:
    return make_result(MANY)


def six_hours() -> Result:
    result = make_result(("gyro", "mahony"), with_traces=False)
    t = np.arange(0, 6 * 3600, 0.01)
    wave = 20 * np.sin(t / 7) + np.where(np.arange(len(t)) == 1_000_001, 60.0, 0.0)
    result.log["duration_s"] = 6 * 3600.0
    at, kept = envelope(t, np.column_stack([wave, wave, (t % 360) - 180]), 30_000)
    columns = dict(zip(("roll", "pitch", "heading"), kept.T, strict=True))
    result.traces = [
        Trace("attitude", name, at, columns, ratio=len(t) / len(at)) for name in ("onboard", "gyro", "mahony")
    ]
    return result


def failed_plugin() -> Result:
    result = make_result()
    result.estimators[2].status, result.estimators[2].reason = "failed", "ZeroDivisionError in step at sample 12"
    result.estimators[2].metrics = {}
    result.traces = [t for t in result.traces if t.row != result.estimators[2].name]
    return result


def broken_numbers() -> Result:
    result = make_result()
    for trace in result.traces:
        trace.columns = {k: np.full(len(trace.t), np.nan) for k in trace.columns}
    return result


POOR = [
    without_rest,
    without_magnetometer,
    one_sample,
    without_reference,
    none_converged,
    nothing_at_all,
    twenty,
    six_hours,
    failed_plugin,
    broken_numbers,
]


@pytest.mark.slow
@pytest.mark.parametrize("make", POOR, ids=lambda f: f.__name__)
def test_a_poor_log_gives_a_whole_page(visit, tmp_path, make):
    result = make()
    result.verdicts = verdicts(result)
    path = tmp_path / "poor.html"
    write_report(result, path)
    assert own_bytes(path) < 2_400_000
    page = visit(path)
    assert page.complaints == []
    assert page.page.get_attribute("html", "data-drawn") == "all"
    answered = bool(main_table(result).columns)
    assert page.page.locator("#h-table").count() == answered
    for heading in ("h-table",) * answered + (
        "h-findings",
        "h-flight",
        "h-rest",
        "h-step",
        "h-drift",
        "h-sensors",
        "h-expert",
    ):
        section = page.page.locator(f"section:has(> #{heading})")
        assert len(section.inner_text()) > len(page.page.locator(f"#{heading}").inner_text()) + 10, heading
    for card in page.page.query_selector_all(".q caption span"):
        assert len(card.inner_text()) > 10


@pytest.mark.slow
def test_of_twenty_filters_a_few_are_shown_and_all_are_one_click_away(visit, tmp_path):
    path = tmp_path / "many.html"
    write_report(twenty(), path)
    page = visit(path)
    assert sum(page.visible("difference").values()) == 6
    assert page.page.locator("#table tbody tr").count() == 21
    page.page.click("#all")
    assert sum(page.visible("attitude").values()) == 21
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 1280


@pytest.mark.slow
def test_a_single_peak_of_six_hours_is_drawn(visit, tmp_path):
    path = tmp_path / "long.html"
    write_report(six_hours(), path)
    page = visit(path)
    highest = page.page.evaluate(
        "() => Math.max(...document.getElementById('attitude').data.filter((t) => t.yaxis === 'y').flatMap((t) => t.y))"
    )
    assert highest > 60
    assert "1 in" in page.page.locator("#fig-attitude figcaption").inner_text()
