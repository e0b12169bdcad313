"""Every sentence of a comparison: its numbers stand in the table, its direction is that of the numbers."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from attlog import metrics
from attlog.compare.comparison import select_questions
from attlog.compare.setting import parse_configuration
from attlog.compare.tables import comparison_tables
from attlog.compare.wording import change_text, comparison_sentences
from attlog.metrics.metric import Answer, Metric, MetricGroup, Resolution, Wording
from tests.compare.made import SECOND, comparison
from tests.metrics.flights import case, row

NINE = [
    (0.30, 0.1),
    (0.28, 0.1),
    (0.25, 0.1),
    (0.27, 0.1),
    (0.31, 0.1),
    (0.26, 0.1),
    (-0.05, 0.1),
    (0.29, 0.1),
    (0.3, 0.1),
]
NO_LAG = [(0.01, 0.05)] * 9


def test_the_sentence_of_nine_flights() -> None:
    found = comparison({"tilt_rmse_deg": NINE, "lag_ms": NO_LAG})
    said = found.verdicts[0]
    assert re.fullmatch(r"kp 0\.6 is significantly worse than kp 0\.3 in tilt error \(\+\d\d %\)\.", said.lead)
    (more,) = said.more
    assert re.fullmatch(
        r"kp 0\.3 holds tilt 22 % closer than kp 0\.6 \(1\d % to 2\d %, better on 8 of 9 logs\)\.", more
    ), more


def test_what_is_better_and_what_is_worse_share_one_sentence() -> None:
    found = comparison({"tilt_rmse_deg": [(-0.3, 0.1)] * 4, "lag_ms": [(11.0, 0.1)] * 4})
    lead = found.verdicts[0].lead
    assert lead == "kp 0.6 is significantly better than kp 0.3 in tilt error (−26 %), worse in lag (+11 ms)."
    assert [line.split(" (")[0] for line in found.verdicts[0].more] == [
        "kp 0.6 holds tilt 26 % closer than kp 0.3",
        "kp 0.3 lags 11 ms less than kp 0.6",
    ]


def test_a_what_if_on_several_flights_gives_the_pooled_change_with_its_interval() -> None:
    flown = [parse_configuration(text) for text in ("px4_ekf2", "px4_ekf2:EKF2_MAG_NOISE=0.2")]
    little = [(0.01, 0.02), (-0.01, 0.02), (0.0, 0.02)] * 3
    found = comparison({"tilt_rmse_deg": NINE, "heading_rmse_deg": little, "lag_ms": NO_LAG}, flown)
    over = found.questions[0].contrasts[0].over
    assert over is not None
    assert found.verdicts[0].lead == (
        f"On 9 flights: tilt error {change_text(found.questions[0], over)}; heading error unchanged."
    )
    wide = comparison({"tilt_rmse_deg": NINE, "heading_rmse_deg": [(-0.3, 0.1), (0.3, 0.1)]}, flown)
    assert re.search(r", heading error [^(]*\(−\d+ % to [^)]*\) on 2 of 9\.$", wide.verdicts[0].lead), wide.verdicts


def test_what_is_not_significant_has_no_sentence() -> None:
    found = comparison({"tilt_rmse_deg": [(-0.3, 0.1)], "lag_ms": [(2.0, 6.0)]})
    assert not any("lag" in text for text in (found.verdicts[0].lead, *found.verdicts[0].more))


def test_where_nothing_is_significant_that_is_said_once() -> None:
    found = comparison({"tilt_rmse_deg": [(0.02, 0.1), (-0.03, 0.1), (0.01, 0.1)]})
    said = found.verdicts[0]
    assert said.lead == "No significant difference of kp 0.6 and kp 0.3 in 1 question on 3 logs."
    assert said.more == []


def test_of_many_significant_questions_four_are_named() -> None:
    worse = [(0.3, 0.01)] * 4
    names = ("tilt_rmse_deg", "heading_rmse_deg", "noise_tilt_deg", "step_error_deg.0.5s", "lag_ms")
    found = comparison({name: [(9.0, 0.1)] * 4 if name == "lag_ms" else worse for name in names})
    assert len(found.verdicts[0].more) == 5
    assert found.verdicts[0].lead.endswith(" and 1 more.")


def test_a_log_that_broke_and_a_row_that_diverged_are_said() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1), (0.3, 0.1)]})
    cell = found.questions[0].cells["flight2.ulg"][SECOND]
    cell.status = "diverged"
    assert "kp 0.6 diverged on flight2.ulg and is not compared there." in comparison_sentences(found)[0].more


def test_agreement_with_what_flew_is_not_called_truth() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1), (0.3, 0.1)]})
    found.logs[1].reference = "onboard (ATT)"
    assert comparison_sentences(found)[0].more == [
        "Errors are differences from onboard (agreement, not truth) on 1 of 2 logs."
    ]
    found.logs[0].reference = "onboard (ATT)"
    assert comparison_sentences(found)[0].more == ["Errors are differences from onboard (agreement, not truth)."]
    found.questions[0] = replace(found.questions[0], metric="noise_tilt_deg")
    assert comparison_sentences(found)[0].more == [], "noise is compared with nothing"


def test_without_any_difference_the_commonest_reason_is_given() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1)]})
    only = found.questions[0].contrasts[0]
    only.over, only.logs = None, [replace(only.logs[0], value=None, reason="too short to rank")]
    assert comparison_sentences(found)[0].lead == "kp 0.6 and kp 0.3 cannot be compared: too short to rank."


@pytest.mark.parametrize("seed", range(15))
def test_every_number_of_a_sentence_stands_in_the_table(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def some(scale: float) -> list[tuple[float, float]]:
        return [(float(rng.normal(0.5 * scale, scale)), float(rng.uniform(0.1, 1.0) * scale)) for _ in range(n)]

    n = int(rng.integers(1, 7))
    found = comparison(
        {
            "tilt_rmse_deg": some(0.3),
            "noise_tilt_deg": some(0.5),
            "lag_ms": some(3.0),
            "step_error_deg.0.5s": some(1.0),
            "drift_rest_deg_per_min": some(2.0),
        }
    )
    cells = " | ".join(cell for table in comparison_tables(found) for cell in table.rows[-1])
    for text in (found.verdicts[0].lead, *found.verdicts[0].more):
        for number in re.findall(r"[+−]?[<\d.]+(?: %|°/min|°| ms)", re.sub(r"\((within|at most)[^)]*\)", "", text)):
            assert number in cells, f"{number} of {text!r} not in {cells!r}"
        for question in found.questions:
            over = question.contrasts[0].over
            assert over is not None
            if over.direction in ("better", "worse") and question.metric == "tilt_rmse_deg" and "closer" in text:
                better = over.value < 1.0
                subject = "kp 0.6" if better else "kp 0.3"
                assert text.startswith(subject), text


def test_a_ratio_seen_from_the_other_side_is_its_inverse() -> None:
    found = comparison({"tilt_rmse_deg": [(math.log(1.32), 0.05)] * 3})
    assert "24 % closer" in found.verdicts[0].more[0]
    assert "+32 %" in comparison_tables(found)[0].rows[-1][3]


# The words of a comparison are those that each metric brings along.

SWAY = Metric(
    "sway_deg",
    "Sway",
    "deg",
    "low",
    "How far it sways.",
    resolution=Resolution(7.0, "a sway of a hand's breadth", "windows"),
    wording=Wording("sways", "less", "more", "sway"),
    scale="ratio",
)


@pytest.fixture
def strangers_file(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A question that this package does not know: one file, and its line in the list of questions."""
    file = ModuleType("attlog.metrics.sway")
    answers = {"sway_deg": Answer(5.0, "deg", "all", 2, 10.0, (0.01, 9.0))}
    file.METRIC_GROUPS = (MetricGroup("sway", "", (SWAY,), lambda case, row, window: answers),)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, file.__name__, file)
    monkeypatch.setattr(metrics, "FILES", (*metrics.FILES, "sway"))
    metrics.groups.cache_clear()
    metrics.definitions.cache_clear()
    yield
    metrics.groups.cache_clear()
    metrics.definitions.cache_clear()


@pytest.mark.usefixtures("strangers_file")
def test_a_metric_of_a_stranger_is_worded_by_its_own_file() -> None:
    (question,) = select_questions(["sway_deg"])
    found = comparison({"sway_deg": [(-0.3, 0.1)] * 3}, questions=[question])
    assert found.questions[0].scale == "ratio"
    assert found.verdicts[0].more[0].startswith("kp 0.6 sways 26 % less than kp 0.3 (")
    assert found.verdicts[0].lead == "kp 0.6 is significantly better than kp 0.3 in sway (−26 %)."


@pytest.mark.usefixtures("strangers_file")
def test_a_metric_of_a_stranger_is_withheld_by_its_own_resolution() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    still = row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    answer = metrics.compute(case([still], []), still, ["all"], only=["sway_deg"])["all"]["sway_deg"]
    assert answer.code == "too_uncertain"
    assert answer.reason == "2 windows are too few to show even a sway of a hand's breadth"
    assert answer.value is None


def test_a_question_is_called_by_the_noun_of_its_metric_and_the_phase() -> None:
    titles = {question.id: question.title for question in select_questions()}
    assert titles["tilt_rmse_deg@airborne"] == "Tilt error"
    assert titles["noise_tilt_deg@hover"] == "Noise added in hover"
    assert titles["drift_air_deg_per_min@airborne"] == "Drift in the air"
