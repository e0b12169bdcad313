"""Do the motors bend a compass's field, and by how much per ampere? Two points tell: the ground and the air.

A regression over the power in flight was never sure enough on 64 real logs. What the place adds (steel in the ground, a
car) goes with the ground as well: so the ground before take-off and after landing must agree, and the heading in
flight must improve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from attlog.health.assessments.compass.fitting import SIGMAS
from attlog.health.assessments.compass.heading import HeadingProof
from attlog.health.assessments.compass.offset import UNSURE_UT, axes, unsound
from attlog.health.assessments.compass.study import CompassStudy
from attlog.health.assessments.model import Assessment, HealthCase, Verdict, unknown
from attlog.health.sensors import interference
from attlog.health.settings import compass as parameters

MOTORS = "compass_motors"
FAR_SHARE = 0.3
"""Of the earth's horizontal field: ardupilot.org, "Magnetic Interference", calls 30 % the limit."""
LIMIT = "ok where ground and air agree within 4 sigma or 2 uT, fault above 30 % of the horizontal field"
MOVE = "Move the compass away from power wires, or calibrate it against the motors."
VERDICTS: dict[str, Verdict] = {"ok": "ok", "warning": "warning", "fault": "fault"}
SOURCE = "ground against air, two points; 30 %: ardupilot.org, Magnetic Interference"


def assessed(case: HealthCase, study: CompassStudy) -> Assessment:
    """What the motors add to one compass, by the ground and the air."""
    samples, ground, found = study.samples, study.ground, study.motors
    advice = case.log.advice("rest")
    if ground is None:
        why = "No field on the ground with motors off is logged, so their own field is unknown."
        return unknown(samples.source, MOTORS, f"{why} {advice}".strip(), LIMIT, SOURCE)
    added, sigma = study.air.offset - ground.offset, np.hypot(study.air.sigma, ground.sigma)
    size = float(np.linalg.norm(added))
    half = 1.96 * float(np.linalg.norm(sigma * added)) / max(size, 1e-9)
    level = float(np.hypot(added[0], added[1])) / max(float(np.hypot(samples.earth[0], samples.earth[1])), 1e-9)
    agrees = not study.ground_differs
    unsure = agrees and SIGMAS * float(sigma.max()) > UNSURE_UT
    answer = Assessment(
        samples.source,
        MOTORS,
        "unknown" if unsure else "ok" if agrees else "fault" if level > FAR_SHARE else "warning",
        f"In flight {samples.source} reads {axes(added, sigma)} uT more in x, y, z than on the ground{_at(study)}.",
        round(size, 1),
        "uT",
        (round(max(size - half, 0.0), 1), round(size + half, 1)),
        [round(float(x), 2) for x in added],
        [round(1.96 * float(s), 2) for s in sigma],
        study.air.n + ground.n,
        round(samples.seconds, 1),
        threshold=LIMIT,
        source=SOURCE,
        evidence=_evidence(study),
    )
    if not agrees:
        answer.why_no_setting = why_not(study)
        if not unsound(study) and turns_heading(study):
            answer.action = MOVE
        if found is not None and not answer.why_no_setting:
            offer = parameters.proposal(
                case.log, samples.mag, 1e-6 * found.offset, 1e-6 * found.per_unit, samples.power_kind
            )
            answer.settings, answer.why_no_setting = offer.settings, offer.refused
            if offer.refused and study.motor_proof is not None:
                answer.action = (
                    f"{offer.refused} Run attlog health again: {_promise(samples.source, study.motor_proof)}"
                )
    return answer


def by_size(case: HealthCase, source: str) -> list[Assessment]:
    """Whether the size of the field follows the motors, as the audit says, where no attitude judges the compass."""
    check = next((c for c in case.checks if c.name == interference.NAME and c.verdict in VERDICTS), None)
    if check is None:
        return []
    answer = Assessment(source, MOTORS, VERDICTS[check.verdict], check.text, unit="%", threshold=check.threshold)
    answer.value = float(check.value) if isinstance(check.value, int | float) else None
    answer.source = "correlation in flight; ardupilot.org, Magnetic Interference"
    if answer.verdict != "ok":
        answer.why_no_setting = "Without a heading by motion no value is known. Fly with GNSS, turning and braking."
        answer.action = case.log.remedies.get("interference", MOVE)
    return [answer]


def turns_heading(study: CompassStudy) -> bool:
    """Whether the motors may turn the heading: their field is not vertical only, and without it it is no worse."""
    proof = study.motor_proof
    return bool(study.ground_differs_along[:2].any()) and (proof is None or proof.after < proof.before)


def _promise(source: str, proof: HeadingProof) -> str:
    return f"compensated for the motors, {source} would err by {proof.after:.0f} deg instead of {proof.before:.0f}."


def advised(answers: Sequence[Assessment], studies: Sequence[CompassStudy]) -> list[Assessment]:
    """The answers to the studies: of compasses that the motors bend, all say to use the one that power explains best.

    Another one whose own compensation does not mend its heading has no better advice.
    """
    proven = [(a, s) for a, s in zip(answers, studies, strict=True) if a.action and s.motors and not why_not(s)]
    if not proven:
        return list(answers)
    best, study = min(proven, key=lambda pair: pair[1].motor_proof.after if pair[1].motor_proof else np.inf)
    if study.motor_proof is None or study.motor_proof.after >= min(s.proof.before for s in studies):
        return list(answers)
    first = f"Set the values of {best.sensor}: {_promise(best.sensor, study.motor_proof)}"
    first = first if best.settings else best.action
    return [
        replace(a, action=f"{first} Then use {best.sensor}.") if a.action and why_not(s) else a
        for a, s in zip(answers, studies, strict=True)
    ]


def why_not(study: CompassStudy) -> str:
    """Why no compensation for the motors is offered; empty where it may be."""
    if why := unsound(study):
        return why
    if study.motors is None:
        return "The log holds no current and no throttle that the field could follow."
    if study.before is None or study.after is None:
        missing = "before take-off" if study.before is None else "after landing"
        return f"The ground {missing} is not logged: motors or the place bend the field. Stay there 20 s, logging."
    if not study.ground_repeats:
        return "The ground before take-off and after landing differ: it is the field of the motors or of the place."
    if not study.follows_motors:
        return "A compensation does not improve the heading enough in the half that it was not fitted to."
    return ""


def _at(study: CompassStudy) -> str:
    if study.motors is None:
        return ""
    power = study.motors.power
    return f", at {power:.3g} A" if study.samples.power_kind == "current" else f", at {100 * power:.0f} % of throttle"


def _evidence(study: CompassStudy) -> list[str]:
    found, samples = study.motors, study.samples
    said = []
    if found is not None and study.ground_differs:
        unit = "uT per ampere" if samples.power_kind == "current" else "uT at full throttle"
        shown = ", ".join(f"{x:.3g}" for x in found.per_unit)
        said.append(f"That is {shown} {unit} in x, y, z.")
    if study.motor_proof is not None and study.ground_differs:
        said.append(study.motor_proof.sentence)
    if study.before is not None and study.after is not None:
        apart = float(np.linalg.norm(study.before.offset - study.after.offset))
        said.append(f"Before take-off and after landing the ground differs by {apart:.1f} uT.")
    return said
