"""What a part is judged by was found without it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog.compare.sweep.many import SettingResult
from attlog.compare.tune import tune as tuning
from attlog.compare.tune.objective import objective
from attlog.compare.tune.search import SearchResult
from attlog.metrics.answer import Answer

TERMS = objective(["tilt=1"])


class MadeLog(SimpleNamespace):
    """A log on which the tilt error is 1 deg and as much more as kp is away from the ``best`` there."""

    def __call__(self, settings: list[dict[str, Any]]) -> list[SettingResult]:
        values = [1.0 + 5.0 * abs(s.get("kp", 1.0) - self.best) for s in settings]
        return [SettingResult({TERMS[0].metric: Answer(v, "deg", "all")}, "ok", "") for v in values]


def on_a_grid(free: object, costs: Any, *_: object) -> SearchResult:
    """The best of eleven settings."""
    settings = [{"kp": round(0.1 * k, 1)} for k in range(11)]
    found = costs(settings)
    return SearchResult(settings[int(found.argmin())], float(found.min()), [])


def test_the_gains_of_a_fold_are_the_best_of_the_other_logs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "search", on_a_grid)
    logs: list[Any] = [MadeLog(name="low", best=0.2, asked=()), MadeLog(name="high", best=0.8, asked=())]
    found = tuning.tune("mahony", [], TERMS, logs, [], {"kp": 1.0}, 6, 1)
    assert {fold.left_out[0].name: fold.found.setting["kp"] for fold in found.folds} == {"low": 0.8, "high": 0.2}
    (judged,) = found.judged
    assert judged.after == pytest.approx([4.0, 4.0])
