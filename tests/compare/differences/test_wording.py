"""The words of a comparison are those that each metric brings along."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest

from attlog import metrics
from attlog.compare.differences.questions import asked
from attlog.metrics.answer import Answer
from attlog.metrics.base import Metric, Resolution, Wording
from tests.compare.flights import comparison
from tests.metrics.flights import case, row

SWAY = Metric(
    "sway_deg",
    "Sway",
    "deg",
    "low",
    (),
    "How far it sways.",
    resolution=Resolution(7.0, "a sway of a hand's breadth", "windows"),
    wording=Wording("sways", "less", "more", "sway"),
    scale="ratio",
)


@pytest.fixture
def strangers_file(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A question that this package does not know: one file, and its line in the list of questions."""
    file = ModuleType("attlog.metrics.sway")
    file.METRICS = (SWAY,)  # type: ignore[attr-defined]
    file.compute = lambda case, row, window: {  # type: ignore[attr-defined]
        "sway_deg": Answer(5.0, "deg", window, 2, 10.0, (0.01, 9.0))
    }
    monkeypatch.setitem(sys.modules, file.__name__, file)
    monkeypatch.setattr(metrics, "QUESTIONS", (*metrics.QUESTIONS, "sway"))
    metrics.questions.cache_clear()
    yield
    metrics.questions.cache_clear()


@pytest.mark.usefixtures("strangers_file")
def test_a_metric_of_a_stranger_is_worded_by_its_own_file() -> None:
    (question,) = asked(["sway_deg"])
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
    titles = {question.id: question.title for question in asked()}
    assert titles["inclination_rmse_deg@airborne"] == "Tilt error"
    assert titles["noise_tilt_deg@hover"] == "Noise added in hover"
    assert titles["drift_air_deg_per_min@airborne"] == "Drift in the air"
