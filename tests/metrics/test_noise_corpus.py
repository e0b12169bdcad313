"""Noise and ranking on flights whose truth is known."""

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics import compute, rank
from attlog.metrics.evidence.samples import detrended, deviations
from attlog.metrics.noise import added as noise
from attlog.metrics.noise import variances
from attlog.metrics.statistics import intervals as interval
from tests.metrics.test_corpus import row_of, trial_of

pytestmark = pytest.mark.slow

FILTERS = ("complementary@fan", "mahony@xu-0.6", "mahony:kp=2", "madgwick")
FLIGHTS = ("px4/px4_hover.ulg", "px4/px4_wind.ulg", "px4/px4_steps.ulg", "ardupilot/copter_wind_guided.bin")


def in_truth(row, phase, begin):
    """Standard deviation (deg) of roll and pitch of the error against truth in a window, its straight line removed."""
    e = row.errors
    i, j = np.searchsorted(e.t, [begin, begin + 5.0])
    apart = rotation.error(e.q_est[i:j], e.q_ref[i:j])
    x = detrended(e.t[i:j], deviations(apart)[:, :2] if phase == "rest" else tilt_of(apart))
    return np.sqrt(np.sum(x**2) / 2 / (j - i - 2))


def tilt_of(apart):
    return np.degrees(rotation.to_rotvec(rotation.error(apart, rotation.mean(apart))))[:, :2]


@pytest.mark.parametrize("name", FLIGHTS)
def test_noise_without_a_reference_is_that_of_the_error_against_truth(corpus, name):
    case = trial_of(corpus / "sitl" / name, ",".join(FILTERS))
    ratios = {"hover": [], "cruise": []}
    for phase, found in ratios.items():
        for row in (r for r in case.rows if r.kind == "replay"):
            told = variances.measured(case, row, phase, phase)
            for begin, v in zip(told.t0, told.variances[:, 3], strict=True) if told else ():
                found.append(np.sqrt(v) / in_truth(row, phase, begin))
    together = np.concatenate(list(ratios.values()))
    assert len(together) >= 8
    assert 0.9 <= np.median(together) <= 1.05
    for found in filter(len, ratios.values()):
        assert 0.85 <= np.median(found) <= 1.1


@pytest.mark.parametrize("name", FLIGHTS)
def test_rows_told_apart_by_noise_stand_in_the_order_of_their_truth(corpus, name):
    case = trial_of(corpus / "sitl" / name, ",".join(FILTERS))
    table = {r.name: compute(case, r, ["hover", "cruise"]) for r in case.rows}
    marks = rank(table, case.rows)
    seen = 0
    for phase, columns in marks.worst.items():
        best, worst = marks.best[phase].get("noise_tilt_deg", []), columns.get("noise_tilt_deg", [])
        for better, worse in ((a, b) for a in best for b in worst):
            typical = []
            for row in (row_of(case, better), row_of(case, worse)):
                t0 = variances.measured(case, row, phase, phase).t0
                typical.append(np.mean([np.log(in_truth(row, phase, begin)) for begin in t0]))
            assert typical[0] < typical[1]
            seen += 1
    assert seen or name != FLIGHTS[0]


RESTS = (
    "px4/px4_static.ulg",
    "px4/px4_hover.ulg",
    "px4/px4_long.ulg",
    "ardupilot/copter_static_hop.bin",
    "ardupilot/copter_hover_rest.bin",
    "ardupilot/copter_long.bin",
)


def test_two_windows_of_a_rest_tell_the_others_and_not_by_being_wide(corpus):
    """Share of chunks of 10 s whose interval, and whose interval of half the width, holds the others: 94 and 81 %."""
    whole, half = [], []
    for name in RESTS:
        case = trial_of(corpus / "sitl" / name, ",".join(FILTERS))
        for row in (r for r in case.rows if r.kind == "replay"):
            told = variances.measured(case, row, "rest", "rest")
            for v in np.log(told.variances[:, :3]).T if told and len(told.t0) >= 5 else ():
                for first in range(0, len(v) - 1, 2):
                    low, high = interval.of_moderated(v[first : first + 2], noise.PRIORS["rest"])
                    away = np.abs(np.delete(v, [first, first + 1]).mean() - 0.5 * (low + high)) / (high - low)
                    whole.append(away <= 0.5)
                    half.append(away <= 0.25)
    assert len(whole) >= 100
    assert np.mean(whole) >= 0.88
    assert np.mean(half) <= 0.9
