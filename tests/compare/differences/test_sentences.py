"""Every sentence of a comparison: its numbers stand in the table, its direction is that of the numbers."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from attlog.compare.differences.sentences import verdicts
from attlog.compare.tables.table import tables
from tests.compare.flights import SECOND, comparison

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
    found = comparison({"inclination_rmse_deg": NINE, "lag_ms": NO_LAG})
    said = found.verdicts[0]
    assert re.fullmatch(r"kp 0\.6 is significantly worse than kp 0\.3 in tilt error \(\+\d\d %\)\.", said.lead)
    (more,) = said.more
    assert re.fullmatch(
        r"kp 0\.3 holds tilt 22 % closer than kp 0\.6 \(1\d % to 2\d %, better on 8 of 9 logs\)\.", more
    ), more


def test_identical_configurations_have_no_difference_and_that_is_said() -> None:
    same = [(0.0, 0.0)] * 3
    found = comparison({"inclination_rmse_deg": same, "lag_ms": same})
    assert found.verdicts[0].lead == "No difference: kp 0.6 and kp 0.3 give the same in every question, on 3 logs."
    for question in found.questions:
        over = question.contrasts[0].over
        assert over is not None
        assert over.direction == "same"
        assert over.value == (1.0 if question.scale == "ratio" else 0.0)


def test_what_is_better_and_what_is_worse_share_one_sentence() -> None:
    found = comparison({"inclination_rmse_deg": [(-0.3, 0.1)] * 4, "lag_ms": [(11.0, 0.1)] * 4})
    lead = found.verdicts[0].lead
    assert lead == "kp 0.6 is significantly better than kp 0.3 in tilt error (−26 %), worse in lag (+11 ms)."
    assert [line.split(" (")[0] for line in found.verdicts[0].more] == [
        "kp 0.6 holds tilt 26 % closer than kp 0.3",
        "kp 0.3 lags 11 ms less than kp 0.6",
    ]


def test_what_is_not_significant_has_no_sentence() -> None:
    found = comparison({"inclination_rmse_deg": [(-0.3, 0.1)], "lag_ms": [(2.0, 6.0)]})
    assert not any("lag" in text for text in (found.verdicts[0].lead, *found.verdicts[0].more))


def test_where_nothing_is_significant_that_is_said_once() -> None:
    found = comparison({"inclination_rmse_deg": [(0.02, 0.1), (-0.03, 0.1), (0.01, 0.1)]})
    said = found.verdicts[0]
    assert said.lead == "No significant difference of kp 0.6 and kp 0.3 in 1 question on 3 logs."
    assert said.more == []


def test_of_many_significant_questions_four_are_named() -> None:
    worse = [(0.3, 0.01)] * 4
    names = ("inclination_rmse_deg", "heading_rmse_deg", "noise_tilt_deg", "step_error_deg.0.5s", "lag_ms")
    found = comparison({name: [(9.0, 0.1)] * 4 if name == "lag_ms" else worse for name in names})
    assert len(found.verdicts[0].more) == 5
    assert found.verdicts[0].lead.endswith(" and 1 more.")


def test_a_log_that_broke_and_a_row_that_diverged_are_said() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1), (0.3, 0.1)]})
    cell = found.questions[0].cells["flight2.ulg"][SECOND]
    cell.status = "diverged"
    assert "kp 0.6 diverged on flight2.ulg and is not compared there." in verdicts(found)[0].more


def test_agreement_with_what_flew_is_not_called_truth() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1), (0.3, 0.1)]})
    found.logs[1].reference = "onboard (ATT)"
    assert verdicts(found)[0].more == ["Errors are differences from onboard (agreement, not truth) on 1 of 2 logs."]
    found.logs[0].reference = "onboard (ATT)"
    assert verdicts(found)[0].more == ["Errors are differences from onboard (agreement, not truth)."]
    found.questions[0].metric = "noise_tilt_deg"
    assert verdicts(found)[0].more == [], "noise is compared with nothing"


def test_without_any_difference_the_commonest_reason_is_given() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1)]})
    only = found.questions[0].contrasts[0]
    only.over, only.logs[0].value, only.logs[0].reason = None, None, "too short to rank"
    assert verdicts(found)[0].lead == "kp 0.6 and kp 0.3 cannot be compared: too short to rank."


@pytest.mark.parametrize("seed", range(40))
def test_every_number_of_a_sentence_stands_in_the_table(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def some(scale: float) -> list[tuple[float, float]]:
        return [(float(rng.normal(0.5 * scale, scale)), float(rng.uniform(0.1, 1.0) * scale)) for _ in range(n)]

    n = int(rng.integers(1, 7))
    found = comparison(
        {
            "inclination_rmse_deg": some(0.3),
            "noise_tilt_deg": some(0.5),
            "lag_ms": some(3.0),
            "step_error_deg.0.5s": some(1.0),
            "drift_rest_deg_per_min": some(2.0),
        }
    )
    cells = " | ".join(cell for table in tables(found) for cell in table.rows[-1])
    for text in (found.verdicts[0].lead, *found.verdicts[0].more):
        for number in re.findall(r"[+−]?[<\d.]+(?: %|°/min|°| ms)", re.sub(r"\((within|at most)[^)]*\)", "", text)):
            assert number in cells, f"{number} of {text!r} not in {cells!r}"
        for question in found.questions:
            over = question.contrasts[0].over
            assert over is not None
            if over.direction in ("better", "worse") and question.metric == "inclination_rmse_deg" and "closer" in text:
                better = over.value < 1.0
                subject = "kp 0.6" if better else "kp 0.3"
                assert text.startswith(subject), text


def test_a_ratio_seen_from_the_other_side_is_its_inverse() -> None:
    found = comparison({"inclination_rmse_deg": [(math.log(1.32), 0.05)] * 3})
    assert "24 % closer" in found.verdicts[0].more[0]
    assert "+32 %" in tables(found)[0].rows[-1][3]
