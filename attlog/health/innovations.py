"""Test ratios of the onboard estimator: rejected aids, too small noise parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside
from attlog.flight import aiding as parameters
from attlog.flight.model import InnovationTest
from attlog.health.check import Check, HealthCase, Setting, unknown
from attlog.health.flown import driven_spans, held_seconds
from attlog.health.heading import left_by_estimator
from attlog.health.regression import median_interval
from attlog.segments.flight_signs import true_runs
from attlog.story.estimator_events import Rejection, aid_rejections

# Test ratio: innovation / (gate x standard deviation), for both firmwares the root. Above 1 the aid is rejected; an
# innovation of one expected standard deviation gives 1 / gate.

# Minimum ratios for a 95th percentile.
MIN_RATIOS = 20
# ArduPilot's EKF3 resets to GNSS after this time of rejection (AP_NavEKF3.h, posRetryTimeUseVel_ms).
LONG_REJECTION_S = 10.0
# Limits of the share of flight above 1; 0.3 % for Gaussian innovations and the smallest gate of 3 sigma.
OFTEN_SHARE, FAULT_SHARE = 0.02, 0.10
# Minimum uninterrupted time above 1, to exclude single outliers.
MIN_REJECTION_S = 1.0
LIMIT = f"ok: above 1 for less than {MIN_REJECTION_S:.0f} s in all, "
LIMIT += f"or for {100 * OFTEN_SHARE:.0f} % and never that long on end; "
LIMIT += f"fault: {LONG_REJECTION_S:.0f} s on end or {100 * FAULT_SHARE:.0f} %"
SOURCE = "the firmware's own gate; some EKFs reset after 10 s"
# What a check of a rejected position is about.
REJECTED_POSITION = "rejected_position"
REJECTION_CAUSES = {
    "compass": "A disturbed or badly calibrated compass, or a wrong heading.",
    "velocity": "Bad GNSS, vibration, or a wrong attitude.",
    "position": "Bad GNSS, vibration, or a wrong attitude.",
    "height": "A drifting barometer or vibration.",
    "airspeed": "A blocked or badly calibrated airspeed sensor.",
}
POSITION_ACTION = "Check vibration, the GNSS antenna's view of the sky, and the compass."
REJECTION_ACTIONS = {
    "velocity": POSITION_ACTION,
    "position": POSITION_ACTION,
    "height": "Shield the barometer from wind and light, and check vibration.",
    "airspeed": "Check the tubes of the airspeed sensor, and calibrate it.",
}


class RatioSummary(NamedTuple):
    """Test ratios of an aid: ``above`` s of ``seconds`` are above 1, ``longest`` (t0, t1) s without a break."""

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


def ratio_summaries(case: HealthCase) -> list[RatioSummary]:
    """Return the summary of test ratios of each aid used in flight."""
    flown = driven_spans(case)
    found = [_ratio_summary(test, flown) for test in case.log.estimator.innovation_tests]
    return [one for one in found if one is not None]


def _ratio_summary(test: InnovationTest, flown: list[Span]) -> RatioSummary | None:
    """Return the summary of an aid; None where unused: no ratios in flight, or only zeros."""
    use = inside(test.t, flown) & np.isfinite(test.ratio)
    t, ratio = test.t[use], test.ratio[use]
    if len(t) < MIN_RATIOS or not ratio.any():
        return None
    held = held_seconds(t)
    above = ratio > 1.0
    stretches = [(float(t[a]), float(t[b - 1] + held[b - 1])) for a, b in true_runs(above)]
    return RatioSummary(
        test.aid,
        test.source,
        float(median(ratio)),
        median_interval(t, ratio),
        float(quantile(ratio, 0.95)),
        float(held[above].sum()),
        max(stretches, key=lambda s: s[1] - s[0], default=None),
        len(t),
        float(held.sum()),
    )


def innovation_checks(case: HealthCase) -> list[Check]:
    """Check each aid whose ratios were logged in flight; unknown where none were."""
    if not case.log.attitudes or not driven_spans(case):
        return []
    found = ratio_summaries(case)
    if not found:
        why = parameters.advise_test_ratios(case.log)
        if any(test.ratio.any() for test in case.log.estimator.innovation_tests):
            why = "No flight is long enough to judge the EKF's test ratios."
        return [unknown("innovations", why, LIMIT, sensor="EKF", source=SOURCE)]
    rejections = {one.aid: one for one in aid_rejections(case.log, case.segments) if one.spans}
    return [_ratio_check(case, one, rejections.get(one.aid)) for one in found]


def _ratio_check(case: HealthCase, one: RatioSummary, rejection: Rejection | None) -> Check:
    share = one.above / max(one.seconds, 1e-9)
    text = f"The EKF's {one.aid} test ratio is {one.median:.2f} in the median, {one.p95:.2f} in the 95th percentile"
    check = Check("innovations", "ok", f"{text}.", round(one.median, 3), "of the gate", LIMIT, sensor=f"EKF {one.aid}")
    check.source, check.n, check.seconds = SOURCE, one.n, round(one.seconds, 1)
    check.ci95 = (round(one.interval[0], 3), round(one.interval[1], 3))
    logged = f"Logged as {one.source}."
    if one.longest is None:
        check.evidence = [f"It stays below 1 in {one.seconds:.0f} s of flight.", logged]
    else:
        check.t = round(one.longest[0], 1)
        check.evidence = [
            f"It is above 1 for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s, "
            f"the longest {one.longest_s:.1f} s from {one.longest[0]:.1f} s.",
            logged,
        ]
    if one.above >= MIN_REJECTION_S and (share > OFTEN_SHARE or one.longest_s >= MIN_REJECTION_S):
        fault = share > FAULT_SHARE or one.longest_s >= LONG_REJECTION_S
        check.verdict = "fault" if fault else "warning"
        check.text = (
            f"The EKF rejects its {one.aid} for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s."
        )
        check.evidence.insert(0, f"{text}.")
        check.cause = REJECTION_CAUSES[one.aid]
        if one.aid == "compass":
            check.kind = "compass"
            explained = case.trouble("compass_orientation") or left_by_estimator(case.found)
            check.action = "" if explained else case.log.remedy("compass")
        if rejection is not None:
            check.evidence.insert(0, check.text)
            check.text, check.count = rejection.text, len(rejection.spans)
            check.t, check.t_end = rejection.spans[0][0], rejection.spans[-1][1]
            check.about = REJECTED_POSITION if one.aid == "position" else ""
        wrong = case.trouble("heading_by_gnss")
        if one.aid in REJECTION_ACTIONS and not wrong:
            check.action = REJECTION_ACTIONS[one.aid]
        if wrong and one.aid in ("velocity", "position"):
            check.why_no_setting = "The heading is wrong, not GNSS: turned by one angle, both agree."
            check.evidence.append(wrong[0].text)
    else:
        suggest_noise(case, one, check)
    return check


# Proposal of a larger noise parameter. A consistent filter has a median ratio near 0.7 / gate: 0.13 for a gate of 5,
# 0.22 for 3. Defaults of both firmwares are conservative: 0.01 to 0.1 on 30 sound flights. Above 0.5 the filter follows
# every fix and rejects gusts; without other faults the proper noise is the old one times (median x gate).

# Minimum median ratio of a too small noise, and maximum share of the flight above 1.
HIGH_RATIO, RARE_SHARE = 0.5, 0.01
# Minimum flight time for a proposal.
MIN_NOISE_FLIGHT_S = 60.0
# Maximum ratio of new to old noise.
MAX_NOISE_FACTOR = 3.0
# Checks that name another cause of large ratios.
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


def suggest_noise(case: HealthCase, one: RatioSummary, check: Check) -> None:
    """Propose a larger noise parameter where test ratios of a sound flight stay high."""
    if one.interval[0] <= HIGH_RATIO or one.above > RARE_SHARE * one.seconds or one.seconds < MIN_NOISE_FLIGHT_S:
        return
    check.verdict = "warning"
    check.evidence.append(
        "Half of all innovations use up more than half of the gate: a gust or a turn is rejected next."
    )
    wrong = dict.fromkeys(c.question.replace("_", " ") for c in case.trouble(*UNSOUND_CHECKS))
    if wrong:
        check.why_no_setting = f"Something else is wrong first: {', '.join([*wrong][:3])}."
        return
    known = parameters.noise_parameter(case.log, one.aid, one.source)
    if known is None:
        check.why_no_setting = "The log does not hold the noise and the gate of this aid."
        return
    larger = min(one.median * known.gate, MAX_NOISE_FACTOR)
    new = float(f"{min(max(known.old * larger, known.low), known.high):.2g}")
    if new <= known.old:
        check.why_no_setting = f"{known.name} is as large as it may be."
        return
    check.settings = [Setting(known.name, known.old, new)]
    check.action = f"A suggestion: {known.name} {known.old:g} expects less than happens; {new:g} fits this flight."
