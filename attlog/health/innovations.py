"""Innovation test ratios of the onboard estimator in flight: rejections of aids, and noise that is set too small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.core.spans import Span, inside
from attlog.flight import aiding as parameters
from attlog.flight.model import Array, InnovationTest
from attlog.health import delays
from attlog.health.check import Check, HealthCase, Setting, unknown
from attlog.segments.flight_signs import true_runs
from attlog.story.estimator_events import Rejection, aid_rejections

LONG_REJECTION_S = 10.0
"""ArduPilot's EKF3 resets to GNSS that it rejected for so long (AP_NavEKF3.h, posRetryTimeUseVel_ms)."""
# How far were the aids of the onboard estimator from what it expected, in flight: arrays for figures and questions.
#
# A test ratio is innovation over gate and standard deviation (in both firmwares the root is what is kept): 1 is
# rejected,
# and 1 / gate is one standard deviation of what the estimator expects.

MAX_RATIO_POINTS = 1500
MIN_RATIOS = 20


@dataclass(frozen=True, slots=True)
class RatioSeries:
    """Test ratios of an aid for a figure: the largest of each part of the flight, ``ratio`` (n,) at ``t`` (n,) s."""

    aid: str
    source: str
    t: Array
    ratio: Array


@dataclass(frozen=True, slots=True)
class RatioSummary:
    """Test ratios of an aid in flight. ``above`` s of ``seconds`` are above 1, ``longest`` (t0, t1) s without break."""

    aid: str
    source: str
    median: float
    interval: tuple[float, float]
    p95: float
    above: float
    longest: Span | None
    n: int
    seconds: float

    @property
    def longest_s(self) -> float:
        """The longest time above 1 without a break, s."""
        return 0.0 if self.longest is None else self.longest[1] - self.longest[0]


def ratio_series(case: HealthCase) -> list[RatioSeries]:
    """Per aid that was used its test ratios over the whole log, thinned to MOST_POINTS by maxima, for a figure."""
    found = []
    for test in case.log.estimator.innovation_tests:
        good = np.isfinite(test.ratio) & np.isfinite(test.t)
        t, ratio = test.t[good], test.ratio[good]
        if len(t) == 0 or not ratio.any():
            continue
        found.append(RatioSeries(test.aid, test.source, *thin_by_maxima(t, ratio)))
    return found


def thin_by_maxima(t: Array, x: Array) -> tuple[Array, Array]:
    """At most MOST_POINTS of samples (n,): of equal numbers of neighbours the largest, at its own time."""
    if len(t) <= MAX_RATIO_POINTS:
        return t, x
    starts = np.linspace(0, len(t), MAX_RATIO_POINTS + 1).astype(np.int64)[:-1]
    largest = np.maximum.reduceat(x, starts)
    part = np.searchsorted(starts, np.arange(len(t)), side="right") - 1
    is_largest = x == largest[part]
    first = np.flatnonzero(is_largest)
    at = first[np.unique(part[first], return_index=True)[1]]
    return t[at], x[at]


def ratio_summaries(case: HealthCase) -> list[RatioSummary]:
    """Per aid that was used in flight."""
    flown = delays.flight_spans(case)
    found = [_ratio_summary(test, flown) for test in case.log.estimator.innovation_tests]
    return [one for one in found if one is not None]


def _ratio_summary(test: InnovationTest, flown: list[Span]) -> RatioSummary | None:
    """None where an aid was not used: no ratios in flight, or nothing but zeros."""
    use = inside(test.t, flown) & np.isfinite(test.ratio)
    t, ratio = test.t[use], test.ratio[use]
    if len(t) < MIN_RATIOS or not ratio.any():
        return None
    held = delays.held_seconds(t)
    above = ratio > 1.0
    stretches = [(float(t[a]), float(t[b - 1] + held[b - 1])) for a, b in true_runs(above)]
    return RatioSummary(
        test.aid,
        test.source,
        float(np.median(ratio)),
        delays.median_interval(t, ratio),
        float(np.percentile(ratio, 95.0)),
        float(held[above].sum()),
        max(stretches, key=lambda s: s[1] - s[0], default=None),
        len(t),
        float(held.sum()),
    )


# Is the noise that the onboard estimator expects of an aid too small? A suggestion, where a sound flight shows it.
#
# A ratio of 1 is ``gate`` standard deviations, so a filter that expects what happens has a median near 0.7 / gate:
# 0.13
# for a gate of 5, 0.22 for 3. Medians far below are usual with both firmwares' defaults (0.01 to 0.1 on 30 sound
# flights): they expect more noise than there is, on purpose, so that nothing is suggested. Above 0.5 the filter leans
# on every fix and rejects the next gust; where nothing else is wrong the noise times (median x gate) is what happens.

HIGH_RATIO, RARE_SHARE = 0.5, 0.01
MIN_NOISE_FLIGHT_S = 60.0
"""A shorter flight suggests no noise."""
MAX_NOISE_FACTOR = 3.0
"""At most so many times the old noise in one step."""
UNSOUND_CHECKS = (
    "heading_by_gnss",
    "second_source",
    "compass_offset",
    "compass_turn",
    "force_axes",
    "accelerometer_offset",
    *("gyro_dead", "gyro_range", "gyro_bias", "gyro_spikes", "gyro_against_attitude", "gyro_scale", "gyro_bias_step"),
    *("accelerometer_dead", "accelerometer_rest", "gravity_in_flight", "gravity_direction", "vibration_level"),
    *("field", "compass_motors", "field_against_attitude"),
)
"""Checks that name another cause of large ratios."""


def suggest_noise(case: HealthCase, one: RatioSummary, told: Check) -> None:
    """Add a larger noise to an assessment where the ratios of a sound flight stay high."""
    if one.interval[0] <= HIGH_RATIO or one.above > RARE_SHARE * one.seconds or one.seconds < MIN_NOISE_FLIGHT_S:
        return
    told.verdict = "warning"
    told.evidence.append(
        "Half of all innovations use up more than half of the gate: a gust or a turn is rejected next."
    )
    wrong = dict.fromkeys(check.question.replace("_", " ") for check in case.trouble(*UNSOUND_CHECKS))
    if wrong:
        told.why_no_setting = f"Something else is wrong first: {', '.join([*wrong][:3])}."
        return
    known = parameters.noise_parameter(case.log, one.aid, one.source)
    if known is None:
        told.why_no_setting = "The log does not hold the noise and the gate of this aid."
        return
    larger = min(one.median * known.gate, MAX_NOISE_FACTOR)
    new = float(f"{min(max(known.old * larger, known.low), known.high):.2g}")
    if new <= known.old:
        told.why_no_setting = f"{known.name} is as large as it may be."
        return
    told.settings = [Setting(known.name, known.old, new)]
    told.action = f"A suggestion: {known.name} {known.old:g} expects less than happens; {new:g} fits this flight."


# Does the onboard estimator accept its aids? Test ratios of each in flight, and a noise that is set too small.

OFTEN_SHARE, FAULT_SHARE = 0.02, 0.10
"""Parts of the flight above 1: Gaussian innovations are beyond 3 sigma, the smallest gate, in 0.3 %."""
MIN_REJECTION_S = 1.0
"""Above 1 for so long without a break is no single outlier."""
RATIO_LIMIT = f"ok: above 1 for less than {MIN_REJECTION_S:.0f} s in all, "
RATIO_LIMIT += f"or for {100 * OFTEN_SHARE:.0f} % and never that long on end; "
RATIO_LIMIT += f"fault: {LONG_REJECTION_S:.0f} s on end or {100 * FAULT_SHARE:.0f} %"
RATIO_SOURCE = "the firmware's own gate; some EKFs reset after 10 s"
REJECTION_CAUSES = {
    "compass": "A disturbed or badly calibrated compass, or a wrong heading.",
    "velocity": "Bad GNSS, vibration, or a wrong attitude.",
    "position": "Bad GNSS, vibration, or a wrong attitude.",
    "height": "A drifting barometer or vibration.",
    "airspeed": "A blocked or badly calibrated airspeed sensor.",
}


def innovation_checks(case: HealthCase) -> list[Check]:
    """One for each aid whose ratios were logged in flight; unknown where none were."""
    if not case.log.attitudes or not delays.flight_spans(case):
        return []
    found = ratio_summaries(case)
    if not found:
        return [unknown("innovations", _reason_no_ratios(case), RATIO_LIMIT, sensor="EKF", source=RATIO_SOURCE)]
    rejections = {one.aid: one for one in aid_rejections(case.log, case.segments) if one.spans}
    return [_ratio_check(case, one, rejections.get(one.aid)) for one in found]


def _ratio_check(case: HealthCase, one: RatioSummary, rejection: Rejection | None) -> Check:
    share = one.above / max(one.seconds, 1e-9)
    text = f"The EKF's {one.aid} test ratio is {one.median:.2f} in the median, {one.p95:.2f} in the 95th percentile"
    told = Check(
        "innovations",
        "ok",
        f"{text}.",
        sensor=one.source,
        value=round(one.median, 3),
        unit="of the gate",
        threshold=RATIO_LIMIT,
    )
    told.source, told.n, told.seconds = RATIO_SOURCE, one.n, round(one.seconds, 1)
    told.ci95 = (round(one.interval[0], 3), round(one.interval[1], 3))
    if one.longest is None:
        told.evidence = [f"It stays below 1 in {one.seconds:.0f} s of flight."]
    else:
        told.t = round(one.longest[0], 1)
        told.evidence = [
            f"It is above 1 for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s, "
            f"the longest {one.longest_s:.1f} s from {one.longest[0]:.1f} s."
        ]
    if one.above >= MIN_REJECTION_S and (share > OFTEN_SHARE or one.longest_s >= MIN_REJECTION_S):
        fault = share > FAULT_SHARE or one.longest_s >= LONG_REJECTION_S
        told.verdict = "fault" if fault else "warning"
        told.text = f"The EKF rejects its {one.aid} for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s."
        told.evidence.insert(0, f"{text}.")
        told.cause = REJECTION_CAUSES[one.aid]
        if one.aid == "compass":
            told.kind, told.action = "compass", case.log.remedy("compass")
        if rejection is not None:
            told.evidence.insert(0, told.text)
            told.text, told.count = rejection.text, len(rejection.spans)
            told.t, told.t_end = rejection.spans[0][0], rejection.spans[-1][1]
        wrong = case.trouble("heading_by_gnss")
        if wrong and one.aid in ("velocity", "position"):
            told.why_no_setting = "The heading is wrong, not GNSS: turned by one angle, both agree."
            told.evidence.append(wrong[0].text)
    else:
        suggest_noise(case, one, told)
    return told


def _reason_no_ratios(case: HealthCase) -> str:
    """Why there are no test ratios, and what would log them."""
    if any(test.ratio.any() for test in case.log.estimator.innovation_tests):
        return "No flight is long enough to judge the EKF's test ratios."
    return parameters.advise_test_ratios(case.log)
