"""A paired interval of half a flight holds the difference of the other half (benchmarks/paired_intervals.py)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.analysis import evaluate, prepare
from attlog.compare.configurations.configuration import parse
from attlog.compare.configurations.run import ConfiguredFilter
from attlog.compare.differences.one_log import place
from attlog.compare.differences.paired import estimate
from attlog.compare.differences.questions import asked
from tests.conftest import SAMPLES

SPECS = ("mahony:kp=0.6", "mahony:kp=0.3", "mahony:kp=1.1", "madgwick", "vqf")


@pytest.mark.slow
def test_paired_intervals_hold_the_other_half_in_nine_of_ten() -> None:
    rng, held = np.random.default_rng(0), []
    for log in ("copter_steps_stabilize.bin", "px4_steps.ulg"):
        result = evaluate(prepare(SAMPLES / log), [ConfiguredFilter(parse(text)) for text in SPECS])
        rows = [row for row in result.estimators if row.kind == "replay" and row.status == "ok"]
        for question in asked():
            metric, window = place(question, rows)
            answers = [row.metrics.get(window, {}).get(metric) for row in rows]
            units = [a.units for a in answers if a is not None and a.ranked and a.units is not None]
            for other in units[1:]:
                common = np.intersect1d(units[0].ids, other.ids)
                half = len(common) // 2
                for _ in range(10 if half >= 4 else 0):
                    drawn = rng.permutation(common)
                    one, two = (
                        estimate(units[0], other, np.sort(ids)) for ids in (drawn[:half], drawn[half : 2 * half])
                    )
                    if one.ci95 is not None and two.ci95 is not None:
                        width = math.hypot(one.ci95[1] - one.value, two.ci95[1] - two.value)
                        held.append(abs(one.value - two.value) <= width)
    assert len(held) > 150
    assert 0.90 <= np.mean(held) <= 0.99
