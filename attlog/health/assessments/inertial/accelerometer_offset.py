"""How much does each accelerometer read too much in flight, by GNSS, and what takes that off?

The replayed unit's bias is the smoother's; without one, truth or a smoother as the reference turns the force
(``fits/force``), which tells the horizontal axes. Another unit has that bias and what it reads more. Vibration shifts
an accelerometer as an offset does, but in flight only: along the vertical the ground must confirm it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Array, Imu
from attlog.health.assessments.inertial import accelerometer_rest
from attlog.health.assessments.inertial.biases import FLOOR_M_S2, Bias, acc_bias
from attlog.health.assessments.inertial.blocks import in_air, listed, of_stream, still, usable
from attlog.health.assessments.inertial.imu_instances import LEAST_FLOWN_HZ, difference_in_flight
from attlog.health.assessments.model import Assessment, HealthCase, Verdict, unknown
from attlog.health.fits import force
from attlog.health.fits.regression import interval
from attlog.health.model import graded
from attlog.health.sensors.accelerometer import expected
from attlog.health.settings.accelerometer import proposal
from attlog.segments.once import asked_once

QUESTION = "accelerometer_offset"
OFF_M_S2, FAR_M_S2 = np.array([0.17, 0.17, 0.3]), np.array([0.5, 0.5, 1.0])
"""1 and 3 deg of tilt horizontally; along z the limits of gravity's size at rest."""
SIGMAS, MOST_M_S2 = 4.0, 1.0
"""Offered from so many sigma up to this size: beyond it the smoother's prior holds it back (4.5 became 3.5)."""
TILTED_M_S2 = 0.5
"""3 deg: by less two units of one board may be mounted differently, and their difference is then no offset."""
CONFIRMED = 0.3
"""The ground shows the vertical offset to 0.1 m/s^2 or this part of it."""
LIMIT = "ok up to 0.17 m/s^2 horizontally, 0.3 along z, or 4 sigma; fault above 0.5 and 1 m/s^2"
SOURCE = "1 and 3 deg of tilt; total error measured on 24 flights with truth"
MOVE = "Fly a minute with GNSS: turn slowly through 360 deg and accelerate in several directions."

SET = "Set the offsets, then calibrate the level; or calibrate the accelerometer in six positions."
"""A level that was calibrated with the offset holds it: without it the vehicle would lean."""


def answer(case: HealthCase) -> list[Assessment]:
    """One assessment for each accelerometer that can be judged; one ``unknown`` where none can."""
    units = usable(case)
    if not units:
        return []
    own, why = _replayed(case)
    if own is None or not any(own.known):
        return [replace(unknown(units[0].acc.source, QUESTION, why, LIMIT, SOURCE), action=MOVE)]
    if units[0] is not case.log.replay_imu:
        return []
    biases = [(imu, bias) for imu in units if (bias := _of_unit(case, own, units[0], imu)) is not None]
    found = [_assessed(case, imu, bias, own) for imu, bias in biases]
    return [one for k, one in enumerate(found) if k == 0 or one.verdict != "unknown"]


def _replayed(case: HealthCase) -> tuple[Bias | None, str]:
    """The bias of the replayed unit, or why it is not known."""
    if case.segments is None or not in_air(case.segments):
        return None, "The vehicle does not fly in this log, so GNSS shows no offset."
    found, reference = acc_bias(case), case.reference
    if found is not None and any(found.known):
        return found, ""
    kinds = ("truth", "smoother") if found is None else ("truth",)  # a smoother that does not know it turns no force
    if reference is not None and reference.kind in kinds:
        fitted = force.measured(case.log, case.segments, reference)
        if fitted is not None:
            sigma = np.append(np.hypot(1.5 * fitted.solution.sigma[4:6], FLOOR_M_S2[:2]), np.inf)
            mean = np.append(-fitted.solution.x[4:6], 0.0)
            level = bool(4.0 * sigma[:2].max() <= FAR_M_S2[0])
            by = f"GNSS and {reference.source}"
            return Bias(mean, sigma, (level, level, False), len(fitted.t), fitted.seconds, by), _turned_little(sigma)
    if found is not None:
        return found, _turned_little(found.sigma)
    return None, "No velocity by GNSS in flight that a smoother could use, so no offset."


def _turned_little(sigma: Array) -> str:
    return f"The flight turns too little: the offset is known to ± {1.96 * sigma[:2].max():.2f} m/s^2 only (95 %)."


def _of_unit(case: HealthCase, own: Bias, replayed: Imu, imu: Imu) -> Bias | None:
    """The bias of a unit: that of the replayed one, and what it reads more in flight."""
    if imu is replayed:
        return own
    if imu.acc.rate < LEAST_FLOWN_HZ:
        return None
    more = difference_in_flight(case, "acc", replayed, imu)
    if more is None:
        return None
    return replace(own, mean=own.mean + more.middle, sigma=np.hypot(own.sigma, more.sigma(0.0)))


def limit_of(bias: Bias) -> Array:
    """From which size (3,) on an offset is one, m/s^2."""
    return np.asarray(np.maximum(OFF_M_S2, SIGMAS * bias.sigma))


def is_off(bias: Bias) -> NDArray[np.bool_]:
    """Along which axes (3,) there surely is an offset that counts."""
    return np.asarray(np.array(bias.known) & (np.abs(bias.mean) > limit_of(bias)))


def _assessed(case: HealthCase, imu: Imu, bias: Bias, own: Bias) -> Assessment:
    """The answer for a unit; ``own`` is the bias of the replayed one, by which it was found."""
    known, limits, off = np.array(bias.known), limit_of(bias), is_off(bias)
    worst = int(np.argmax(np.where(known, np.abs(bias.mean) / limits, -1.0)))
    size, sigma = float(bias.mean[worst]), float(bias.sigma[worst])
    verdict: Verdict = graded(abs(size), float(limits[worst]), max(float(FAR_M_S2[worst]), float(limits[worst])))
    source, told = imu.acc.source, interval(size, sigma, 2)
    if off.any():
        also = ", offset or scale" if worst == 2 else ""
        text = f"{source} is off by {size:+.2f} m/s^2 along {'xyz'[worst]} ({told}, 95 %) in flight{also}."
    elif known.all():
        text = f"{source} is off by {listed(bias.mean)} m/s^2 in flight, which is little."
    else:
        verdict = "unknown"
        axes, others = (" and ".join("xyz"[k] for k in np.flatnonzero(which)) for which in (known, ~known))
        text = f"The flight turns too little to show the offset of {source} along {others}; along {axes} it is small."
    found = Assessment(
        source,
        QUESTION,
        verdict,
        text,
        value=round(size, 3),
        unit="m/s^2",
        ci95=(round(size - 1.96 * sigma, 3), round(size + 1.96 * sigma, 3)),
        vector=[round(float(v), 3) for v in bias.mean] if known.all() else [],
        vector_ci95=[round(1.96 * float(v), 3) for v in bias.sigma] if known.all() else [],
        n=bias.n,
        seconds=round(bias.seconds, 1),
        threshold=LIMIT,
        source=SOURCE,
        evidence=_evidence(case, imu, bias),
        action=MOVE if verdict == "unknown" else "",
    )
    if off.any():
        found.why_no_setting = _refusal(case, imu, bias, own)
        if not found.why_no_setting:
            offered = proposal(case.log, imu, np.where(off, bias.mean, 0.0))
            found.settings, found.why_no_setting = offered.settings, offered.refused
        found.action = SET if found.settings else case.log.remedies.get("accelerometer", "")
    return found


def _refusal(case: HealthCase, imu: Imu, bias: Bias, own: Bias) -> str:
    """Why an offset that is there is not offered as a number; empty where it is."""
    off = is_off(bias)
    if float(np.abs(own.mean[np.array(own.known)]).max()) > MOST_M_S2:
        return "Above 1 m/s^2 a flight does not show it exactly; six positions do."
    if imu is not case.log.replay_imu and (off & (np.abs(bias.mean) < TILTED_M_S2))[:2].any():
        return "A unit that is mounted 1 to 3 deg off level reads the same; six positions show which."
    flew = case.log.imu_that_flew
    if flew is not None and len(set(flew.value)) > 1:
        return "The unit in use changed, and the offset of each is not known."
    bad = {c.name for c in case.checks if c.verdict in ("warning", "fault")}
    if "vibration" in bad:
        return "Vibration as strong as here shifts an accelerometer too. Reduce it first, then fly again."
    if force.AXES in bad:
        return "Its axes are exchanged or reversed: correct these first."
    if off[2]:
        ground = on_ground(case, imu, bias)
        if ground is None:
            return "No rest on the ground confirms the vertical offset. Log before arming."
        shown, foreseen = ground
        if abs(shown - foreseen) > max(0.1, CONFIRMED * abs(float(bias.mean[2]))):
            return (
                f"The force on the ground is {shown:+.2f} m/s^2 off gravity, not {foreseen:+.2f}: no constant offset."
            )
    return ""


@asked_once
def on_ground(case: HealthCase, imu: Imu, bias: Bias) -> tuple[float, float] | None:
    """By how much the force on the ground exceeds gravity, and by how much it would by this bias, m/s^2."""
    size = accelerometer_rest.size_at_rest(case, imu)
    if case.segments is None or size is None:
        return None
    shown = of_stream(imu.acc, still(case.segments)[0])
    if shown is None:
        return None
    along = shown.middle / max(float(size.middle[0]), 1e-9)
    mean = np.where(np.array(bias.known), bias.mean, 0.0)
    return float(size.middle[0]) - expected(case.log), float(along @ mean)


def _evidence(case: HealthCase, imu: Imu, bias: Bias) -> list[str]:
    """What found it, the ground, and what the onboard estimator subtracts."""
    told = [f"By {bias.by}, {bias.seconds:.0f} s."]
    if bias.known[2] and (ground := on_ground(case, imu, bias)) is not None:
        told.append(
            f"The force on the ground is {ground[0]:+.2f} m/s^2 off gravity; this offset makes {ground[1]:+.2f}."
        )
    if case.log.acc_bias is not None and imu is case.log.replay_imu and len(case.log.acc_bias.x):
        own = np.nanmedian(case.log.acc_bias.x, axis=0)
        if np.isfinite(own).all():
            told.append(f"The onboard estimator subtracts {listed(own)} m/s^2.")
    return told
