"""When GNSS and magnetometer were true: delays by likelihood.

The delay state alone is biased where a flight hardly moves; the likelihood of a whole run with the delay held is not.
It is searched on a grid around the present value, wider while the best stands at the edge, with a parabola at the end.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.filters.navigation.layout import GNSS_DELAY, MAG_DELAY
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.settings import Tuned
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import Start

USUAL_S, USUAL_SIGMA_S = 0.12, 0.08
LONGEST_S, LONGEST_MAG_S = 0.6, 0.15
MOST_STEPS = 4
MARGIN_S = 0.7
"""Fixes this near to the ends are left out of the search: all delays must see the same ones."""


def by_state(found: Pass, tuned: Tuned) -> Tuned:
    """Delays moved by their smoothed states, each prior staying where it was (0.12 s for GNSS, 0 for the field)."""
    values: dict[str, Any] = {}
    for name, row, usual, sigma, most in (
        ("gnss_delay", GNSS_DELAY, USUAL_S, tuned.prior.gnss_delay, LONGEST_S),
        ("mag_delay", MAG_DELAY, 0.0, tuned.prior.mag_delay, LONGEST_MAG_S),
    ):
        spread = float(found.first_spread[row])
        if spread <= 0.0 or sigma <= 0.0:
            continue
        now = float(getattr(tuned, name)) - usual
        moved = now * (1.0 - min(spread / sigma**2, 1.0)) + float(found.first[row])
        values[name] = float(np.clip(usual + moved, -most, most))
    return replace(tuned, **values)


def by_likelihood(runner: Runner, inputs: Inputs, tuned: Tuned, begin: Start, gate: float, step: float) -> Tuned:
    """The GNSS delay of the highest likelihood on a grid of ``step`` s around the present one, then of a parabola."""
    t = inputs.sensed_at
    inner = float(t[0]) + MARGIN_S, float(t[-1]) - MARGIN_S
    if inputs.velocity is None or inputs.velocity.between(*inner) is None:
        return tuned
    held = begin.copy()
    held.P[GNSS_DELAY, :] = held.P[:, GNSS_DELAY] = 0.0
    par = tuned.packed(inputs.gravity, gate)
    known: dict[int, float] = {}

    def value(k: int) -> float:
        if k not in known:
            tau = tuned.gnss_delay + k * step
            schedule = runner.timetable.scheduled(replace(tuned, gnss_delay=tau), within=inner)
            found = runner.forward(schedule, held, par)
            known[k] = found.likelihood - 0.5 * ((tau - USUAL_S) / USUAL_SIGMA_S) ** 2
        return known[k]

    best = max((-1, 0, 1), key=value)
    for _ in range(MOST_STEPS):
        beyond = max((best - 1, best, best + 1), key=value)
        if beyond == best:
            break
        best = beyond
    left, middle, right = value(best - 1), value(best), value(best + 1)
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    tau = tuned.gnss_delay + (best + float(np.clip(shift, -1.0, 1.0))) * step
    return replace(tuned, gnss_delay=float(np.clip(tau, -LONGEST_S, LONGEST_S)))
