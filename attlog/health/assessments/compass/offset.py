"""Is a compass off, and may its offset be set? One that was fitted in the air holds the motors' field as well.

Pasted, such an offset has turned the heading on the ground, where the estimator takes its yaw, by up to 180 deg. So it
is offered only where the ground shows the same, and where it improves the heading of the half it was not fitted to.
"""

from __future__ import annotations

import numpy as np

from attlog.health.assessments.compass.fitting import LEAST_UT, SIGMAS
from attlog.health.assessments.compass.study import CompassStudy
from attlog.health.assessments.model import Array, Assessment, HealthCase, Verdict
from attlog.health.settings import compass as parameters

OFFSET = "compass_offset"
FAR_UT = 15.0
"""150 mG: the heading swings by 45 deg where the horizontal field is 20 uT."""
UNSURE_UT = 10.0
"""Four sigmas beyond this: nothing found is no answer."""
LIMIT = f"ok up to {SIGMAS:.0f} sigma or {LEAST_UT} uT, fault above {FAR_UT:.0f} uT horizontally"
SOURCE = "measured on 39 simulated flights with truth and 98 compasses"


def assessed(case: HealthCase, study: CompassStudy) -> Assessment:
    """The offset of one compass in flight, with its total error, and what to set."""
    found, samples = study.air, study.samples
    verdict = _verdict(study)
    answer = Assessment(
        samples.source,
        OFFSET,
        verdict,
        f"{samples.source} is off by {axes(found.offset, found.sigma)} uT in x, y, z in flight.",
        round(found.size, 1),
        "uT",
        (round(found.size_ci95[0], 1), round(found.size_ci95[1], 1)),
        [round(float(x), 2) for x in found.offset],
        [round(1.96 * float(s), 2) for s in found.sigma],
        found.n,
        round(samples.seconds, 1),
        threshold=LIMIT,
        source=SOURCE,
        evidence=_evidence(study),
    )
    if verdict == "unknown":
        why = unsound(study)
        answer.why_no_setting = (
            why or "The flight turns too little or its heading is too unsure. Fly turns and hard stops."
        )
    elif verdict != "ok":
        answer.why_no_setting = why_not(case, study)
        if not answer.why_no_setting:
            offer = parameters.proposal(case.log, samples.mag, 1e-6 * found.offset)
            answer.settings, answer.why_no_setting = offer.settings, offer.refused
    return answer


def why_not(case: HealthCase, study: CompassStudy) -> str:
    """Why the offset of the flight is not to be set; empty where it may be."""
    advice = case.log.advice("rest")
    if why := unsound(study):
        return why
    if study.ground is None:
        why = "No sample on the ground separates this offset from the motors' field."
        return f"{why} {advice}" if advice else why
    if study.ground_differs:
        return (
            f"On the ground it is off by {axes(study.ground.offset, study.ground.sigma)} uT. "
            "The motors or the place bend the field, and this offset would be wrong on the ground."
        )
    if not study.ground_agrees:
        return f"The ground does not confirm it: off by {axes(study.ground.offset, study.ground.sigma)} uT there."
    if study.cause == "turn":
        return "A compass mounted askew would read the same: compare its orientation with the parameters."
    if study.cause == "neither":
        return "No constant offset explains the field in flight: motors or soft iron bend it."
    if not study.proof.holds:
        return "The offset does not improve the heading of the half that it was not fitted to."
    return ""


def unsound(study: CompassStudy) -> str:
    """Why the field of the flight is not that of a constant offset of a calibrated compass; empty where it is."""
    if not study.samples.mag.calibrated:
        return "This compass was never calibrated: calibrate it on the ground."
    if not study.steady:
        return "The first half of the flight shows another offset than the second: none is constant."
    return ""


def _verdict(study: CompassStudy) -> Verdict:
    found = study.air
    if found.counts:
        return "fault" if float(np.hypot(found.offset[0], found.offset[1])) > FAR_UT else "warning"
    return "unknown" if SIGMAS * float(found.sigma.max()) > UNSURE_UT else "ok"


def _evidence(study: CompassStudy) -> list[str]:
    said = []
    for when, fit in (("before take-off", study.before), ("after landing", study.after)):
        if fit is not None:
            said.append(f"On the ground {when} it is off by {axes(fit.offset, fit.sigma)} uT ({fit.n} samples).")
    said.append(study.proof.sentence)
    heading = float(np.degrees(np.sqrt(np.mean(study.samples.sigma_heading[study.samples.air] ** 2))))
    said.append(f"The heading by motion alone is known to {heading:.1f} deg (1 sigma), in {study.air.blocks} blocks.")
    return said


def axes(value: Array, sigma: Array) -> str:
    """Three numbers in words, each with half its 95 % interval."""
    return ", ".join(f"{v:.1f} ± {1.96 * s:.1f}" for v, s in zip(value, sigma, strict=True))
