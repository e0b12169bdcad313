"""Does the onboard estimator accept its aids? Test ratios of each in flight, and a noise that is set too small."""

from __future__ import annotations

from attlog.flight.aiding import noise as parameters
from attlog.health.assessments.model import Assessment, HealthCase, unknown
from attlog.health.assessments.onboard import in_flight, noise, test_ratios
from attlog.health.assessments.onboard.test_ratios import RatioSummary
from attlog.health.onboard.aids import LONG_S

QUESTION = "innovations"
OFTEN, MANY = 0.02, 0.10
"""Parts of the flight above 1: Gaussian innovations are beyond 3 sigma, the smallest gate, in 0.3 %."""
LEAST_S = 1.0
"""Above 1 for so long without a break is no single outlier."""
LIMIT = f"ok: above 1 for less than {LEAST_S:.0f} s in all, or for {100 * OFTEN:.0f} % and never that long on end; "
LIMIT += f"fault: {LONG_S:.0f} s on end or {100 * MANY:.0f} %"
SOURCE = "the firmware's own gate; some EKFs reset after 10 s"
CAUSES = {
    "compass": "Look at the questions about the compass first: offsets and motors' fields do this.",
    "velocity": "Look at the heading, the GNSS quality and its delay first.",
    "position": "Look at the heading, the GNSS quality and its delay first.",
    "height": "Look at vibration and at the barometer's exposure to wind and rotors first.",
    "airspeed": "Look at the pitot tube and its calibration first.",
}
HEADING = "heading by GNSS"


def assessments(case: HealthCase) -> list[Assessment]:
    """One for each aid whose ratios were logged in flight; unknown where none were."""
    if not case.log.attitudes or not in_flight.flown(case):
        return []
    found = test_ratios.summaries(case)
    if not found:
        return [unknown("EKF", QUESTION, _missing(case), LIMIT, SOURCE)]
    return [_assessed(case, one) for one in found]


def _assessed(case: HealthCase, one: RatioSummary) -> Assessment:
    share = one.above / max(one.seconds, 1e-9)
    text = f"The EKF's {one.aid} test ratio is {one.median:.2f} in the median, {one.p95:.2f} in the 95th percentile"
    told = Assessment(one.source, QUESTION, "ok", f"{text}.", round(one.median, 3), "of the gate", threshold=LIMIT)
    told.source, told.n, told.seconds = SOURCE, one.n, round(one.seconds, 1)
    told.ci95 = (round(one.interval[0], 3), round(one.interval[1], 3))
    if one.longest is None:
        told.evidence = [f"It stays below 1 in {one.seconds:.0f} s of flight."]
    else:
        told.t = round(one.longest[0], 1)
        told.evidence = [
            f"It is above 1 for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s, "
            f"the longest {one.longest_s:.1f} s from {one.longest[0]:.1f} s."
        ]
    if one.above >= LEAST_S and (share > OFTEN or one.longest_s >= LEAST_S):
        fault = share > MANY or one.longest_s >= LONG_S
        told.verdict = "fault" if fault else "warning"
        told.text = f"The EKF rejects its {one.aid} for {one.above:.1f} s ({100 * share:.1f} %) of {one.seconds:.0f} s."
        told.evidence.insert(0, f"{text}.")
        told.why_no_setting = CAUSES[one.aid]
        wrong = next((c for c in case.checks if c.name == HEADING and c.verdict in ("warning", "fault")), None)
        if wrong is not None and one.aid in ("velocity", "position"):
            told.why_no_setting = "The heading is wrong, not GNSS: turned by one angle, both agree."
            told.evidence.append(wrong.text)
    else:
        noise.suggest(case, one, told)
    return told


def _missing(case: HealthCase) -> str:
    """Why there are no test ratios, and what would log them."""
    if any(test.ratio.any() for test in case.log.innovation_tests):
        return "No flight is long enough to judge the EKF's test ratios."
    return parameters.not_logged(case.log)
