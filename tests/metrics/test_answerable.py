"""Whether a reference plainly follows the gyro: the same answer as the fit of the lag where it is clear, else none."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog import pipeline, reference
from attlog.core.errors import AttlogError
from attlog.pipeline.inspection import inspect
from tests.conftest import corpus_logs, corpus_root

# The stand-in is the gyro alone, and what is possible with it is what filters are judged by.

ONLY_FILTERS_TELL = {"px4_1.6.5_hand_rotation.ulg", "log_copter_3.1.1_nan.log", "bin_plane_3.0.4beta3_nomag.BIN"}
"""The onboard attitude is refused because six filters agree against it: before they run nobody knows."""


def every_log() -> list[Path]:
    root = corpus_root()
    cases = [] if root is None else sorted((root / "logs" / "cases").glob("*"))
    return corpus_logs() + [p for p in cases if p.suffix.lower() in (".ulg", ".bin", ".tlog", ".log")]


def without_smoother(monkeypatch: pytest.MonkeyPatch) -> None:
    choose = reference.choose
    monkeypatch.setattr(reference, "choose", lambda *given, smooth=None, **more: choose(*given, **more))


@pytest.mark.slow
@pytest.mark.parametrize("path", every_log(), ids=lambda p: f"{p.parent.name}-{p.name}")
def test_info_says_of_every_log_what_analyze_can_answer(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compared with the same: info does not run the smoother, and says of it only that it comes first."""
    without_smoother(monkeypatch)
    try:
        result = pipeline.evaluate(pipeline.prepare(path))
    except AttlogError:
        return
    answered = {v.question: v.answered for v in result.verdicts}
    if path.name in ONLY_FILTERS_TELL:
        assert "attitude" in {p.kind for p in result.findings}
        assert inspect_answers(path) != answered, "no longer an exception"
        answered |= {"accuracy": True, "lag": inspect_answers(path)["lag"]}
    said = inspect(path)["answerable"]
    large = {a["question"] for a in said if "only a larger error would be significant" in (a["reason"] or "")}
    assert {a["question"]: a["can"] or (a["question"] in large and answered[a["question"]]) for a in said} == answered


@pytest.mark.slow
def test_of_a_flight_too_short_for_any_small_drift_only_large_ones_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    root = corpus_root()
    if root is None:
        pytest.skip("no corpus")
    path = root / "logs" / "cases" / "copter_3.6.8_compass.bin"
    without_smoother(monkeypatch)
    said = next(a for a in inspect(path)["answerable"] if a["question"] == "yaw_drift")
    assert not said["can"]
    assert "only a larger error would be significant" in said["reason"]
    result = pipeline.evaluate(pipeline.prepare(path))
    told = next(v for v in result.verdicts if v.question == "yaw_drift")
    answers = [row.metrics[told.window].get(told.metric) for row in result.estimators if row.kind == "replay"]
    values = [a.value for a in answers if a is not None and a.value is not None]
    assert told.answered
    assert max(map(abs, values)) > 60.0


def inspect_answers(path: Path) -> dict[str, bool]:
    return {a["question"]: a["can"] for a in inspect(path)["answerable"]}
