"""Huang's tables: times as printed and here, the same flight on other filters, the loop by its transfer function."""

from __future__ import annotations

import math

import numpy as np

from attlog.present.numbers import quantity
from attlog.reproduce import response
from attlog.reproduce.cost import UPDATES
from attlog.reproduce.huang import runs
from attlog.reproduce.huang.runs import DCM, EKF, LEVELS, NEW_EKF, TRACKS, HuangSeed
from attlog.reproduce.judge import mean_text
from attlog.reproduce.paper import PaperTable
from attlog.simulate.autopilot.linear import margins, rise_and_overshoot
from attlog.simulate.autopilot.onboard import TRUTH

PRINTED_MAHONY_S = (0.9995, 0.9880, 1.0023, 1.0029, 0.9851, 1.1822, 1.3897, 1.1918, 1.0115)
PRINTED_EKF_S = (1.8698, 1.8520, 1.8568, 2.2022, 2.0360, 1.9098, 2.1788, 2.4898, 1.8645)
"""Table 1: seconds for 4,000 updates, nine runs."""
NAMED = {TRUTH: "the true attitude", DCM: "Huang's filter", EKF: "Fan's EKF", NEW_EKF: "mekf"}


def times(spent: dict[str, list[float]]) -> PaperTable:
    """Table 1 as it is printed and as it is here."""
    rows = [
        (str(k + 1), f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
        for k, (a, b, c, d) in enumerate(zip(PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF], strict=True))
    ]
    total = [float(np.mean(x)) for x in (PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF])]
    a, b, c, d = total
    rows.append(
        ("mean", f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
    )
    head = ("run", "paper: Mahony", "EKF", "ratio", "here: Mahony", "EKF", "ratio")
    return PaperTable(f"{UPDATES:,} updates (table 1)", head, tuple(rows), "Here: a field at every update.")


def by_filter(found: list[HuangSeed]) -> PaperTable:
    """What the same flight is on each filter."""
    rows = []
    for row in runs.FLOWN_ON:
        one = [s.flown[row] for s in found if row in s.flown]
        rows.append(
            (
                NAMED[row],
                f"{sum(f.crashed for f in one)} of {len(one)}",
                *(
                    mean_text(v, u)
                    for v, u in (
                        ([max(f.most_deg) for f in one], "deg"),
                        ([math.hypot(*f.errors.hover[:2]) for f in one], "deg"),
                        ([math.hypot(*f.errors.moving[:2]) for f in one], "deg"),
                        ([abs(f.returned[-1].left_deg) for f in one], "deg"),
                        ([f.tracked[0].delay_ms for f in one], "ms"),
                    )
                ),
            )
        )
    head = (
        "flown on",
        "crashed",
        "largest angle in hover",
        "tilt error, hover",
        "moves",
        f"left of {LEVELS[-1][0]:g} deg",
        "delay",
    )
    return PaperTable(
        "The same flight on other filters",
        head,
        tuple(rows),
        f"Means over seeds; of EKFs over the first {runs.BESIDE_SEEDS}.",
    )


def linear(found: list[HuangSeed]) -> PaperTable:
    """What the transfer function says beside what the vehicle did on the true attitude."""
    axis = runs.axis_of(0)
    limits = margins(axis)
    t = np.linspace(0.0, 4.0, 4001)
    _, over = rise_and_overshoot(t, axis.step(t))
    back = axis.step(t + runs.TILTED_S) - axis.step(t)
    fall = 1e3 * response.rise_s(t, back, 0.0, float(back[0]), 0.0)
    truth = [s.flown[TRUTH] for s in found]
    rows = [
        ("phase margin", f"{limits.phase_deg:.0f} deg at {limits.phase_at:.0f} rad/s", ""),
        ("gain margin", f"{limits.gain:.1f}", ""),
        ("delay that it stands", f"{1e3 * limits.delay_s:.0f} ms", ""),
        ("90 to 10 % of 20 deg", quantity(fall, "ms"), mean_text([1e3 * f.returned[0].fall_s for f in truth], "ms")),
        ("overshoot of a step", f"{100 * over:.1f} %", ""),
    ]
    for k, (size, period, name) in enumerate(TRACKS):
        told = axis.response(2.0 * math.pi / period)
        late = -float(np.angle(told)) * period / (2.0 * math.pi) * 1e3
        sine = f"{name}, {size:g} deg at {period:g} s"
        rows.append((f"delay, {sine}", quantity(late, "ms"), mean_text([f.tracked[k].delay_ms for f in truth], "ms")))
        rows.append((f"gain, {sine}", f"{abs(told):.2f}", mean_text([f.tracked[k].gain for f in truth], "1")))
    return PaperTable(
        "The loop: transfer function and flight on the true attitude",
        ("", "linear", "flown"),
        tuple(rows),
        "Rotor lag, inertia, gains and the time that sampling and holding take; means over seeds.",
    )
