"""Everything that a flight tells of one compass: its offset in the air and on the ground, and what the motors add."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight import magnetic
from attlog.health.assessments.compass import motion
from attlog.health.assessments.compass.fitting import SIGMAS, OffsetFit, of_samples
from attlog.health.assessments.compass.heading import HeadingProof, crossed, halves
from attlog.health.assessments.compass.samples import FieldSamples, Mask, gathered
from attlog.health.assessments.model import Array, HealthCase
from attlog.health.fits import compass as one_fault
from attlog.reference import declination
from attlog.segments.once import asked_once

ALIVE_UT, MOVES_UT = 5.0, 0.3
"""A compass that reads less, or whose axes all change by less than 3 mG while the vehicle moves, measures nothing."""
SAME_UT, SAME_SHARE = 2.5, 0.2
"""Fields before take-off and after landing are one within 25 mG or a fifth of what the flight adds."""
HALVES_SHARE, HALVES_SIGMAS = 0.4, 3.0
"""Offsets of both halves agree within 40 % of the offset or three sigmas."""
GROUND_UT, GROUND_SHARE = 2.0, 0.5
"""Ground and air differ beyond four sigmas and 20 mG; the ground confirms an offset that lies nearer to it than to
none."""
AS_GOOD, AS_GOOD_DEG = 1.1, 0.5
"""Where the power hardly changes, a constant offset explains the flight as well as the motors do: up to this."""
Cause = Literal["offset", "turn", "neither"]


@dataclass(frozen=True, slots=True)
class MotorField:
    """What the motors add, ``per_unit`` (3,) uT for each ampere or for full throttle.

    ``added`` (3,) uT is what they add in flight, with its sigma (3,), at ``power`` (A, or 0 to 1) more than on the
    ground. ``offset`` (3,) uT is what remains without any power, zero where it may be.
    """

    per_unit: Array
    added: Array
    sigma: Array
    power: float
    offset: Array

    def at(self, samples: FieldSamples) -> Array:
        """What the compass reads too much (n, 3) uT at every sample."""
        power = np.nan_to_num(samples.power, nan=samples.hover)
        return np.asarray(self.offset + power[:, None] * self.per_unit)


@dataclass(frozen=True, slots=True)
class CompassStudy:
    """One compass: fits of the ``air``, and of the ``ground`` ``before`` and ``after`` where it stood with motors off.

    ``steady``: both halves of the flight show the same offset. ``cause``: what alone explains the field in flight, an
    offset, a turn of a compass that is mounted askew, or neither. ``motors`` is None without ground or power.
    """

    samples: FieldSamples
    air: OffsetFit
    before: OffsetFit | None
    after: OffsetFit | None
    ground: OffsetFit | None
    steady: bool
    cause: Cause
    proof: HeadingProof
    motors: MotorField | None
    motor_proof: HeadingProof | None

    @property
    def ground_agrees(self) -> bool:
        """Whether the ground confirms that the compass is off as it is in the air."""
        if self.ground is None or self.ground_differs:
            return False
        apart = self.air.offset - self.ground.offset
        level = float(np.hypot(self.air.offset[0], self.air.offset[1]))
        return float(np.hypot(apart[0], apart[1])) <= max(GROUND_UT, GROUND_SHARE * level)

    @property
    def ground_differs(self) -> bool:
        """Whether the compass reads another field on the ground than in the air."""
        return bool(self.ground_differs_along.any())

    @property
    def ground_differs_along(self) -> NDArray[np.bool_]:
        """Along which axes (3,) it does."""
        if self.ground is None:
            return np.zeros(3, bool)
        limit = np.maximum(SIGMAS * self.air.sigma, GROUND_UT)
        return np.asarray(np.abs(self.air.offset - self.ground.offset) > limit)

    @property
    def follows_motors(self) -> bool:
        """Whether power explains the heading in flight, and no worse than a constant offset does."""
        one, other = self.motor_proof, self.proof
        return one is not None and one.holds and one.after <= AS_GOOD * other.after + AS_GOOD_DEG

    @property
    def ground_repeats(self) -> bool:
        """Whether the compass reads the same before take-off and after landing."""
        if self.before is None or self.after is None or self.ground is None:
            return False
        apart = float(np.linalg.norm(self.before.offset - self.after.offset))
        added = float(np.linalg.norm(self.air.offset - self.ground.offset))
        return apart <= max(SAME_UT, SAME_SHARE * added)


@asked_once
def studies(case: HealthCase) -> tuple[list[CompassStudy], str]:
    """Every compass that can be judged, and why there is none."""
    why = motion.why_none(case)
    model = declination.model(case.log)
    if why or case.motion is None or model is None:
        return [], why
    found: list[CompassStudy] = []
    for mag in case.log.mags:
        if magnetic.dead(mag, case.log.replay_imu):
            continue
        samples = gathered(case, mag, case.motion, model)
        if samples is None or samples.seconds < motion.LEAST_S or not alive(samples):
            continue
        one = studied(samples)
        found += [one] if one is not None else []
    if not found:
        why = f"No compass has {motion.LEAST_S:.0f} s in flight with a heading known to 5 deg. {motion.FLY}"
    return found, why


def alive(samples: FieldSamples) -> bool:
    """Whether the compass reads a field that changes."""
    field = samples.measured[samples.air]
    size = float(np.median(np.linalg.norm(field, axis=1)))
    return size > ALIVE_UT and bool(np.any(np.std(field, axis=0) > MOVES_UT))


def studied(samples: FieldSamples) -> CompassStudy | None:
    """What samples of a compass show; None where they determine nothing."""
    air = of_samples(samples, samples.air)
    if air is None:
        return None
    before, after = (of_samples(samples, use) if use.any() else None for use in (samples.before, samples.after))
    on_ground = samples.before | samples.after
    ground = of_samples(samples, on_ground) if on_ground.any() else None
    parts = halves(samples)
    first, second = (of_samples(samples, half) for half in parts)
    if first is None or second is None:
        return None
    shape = samples.measured.shape
    proof = crossed(samples, parts, (np.broadcast_to(first.offset, shape), np.broadcast_to(second.offset, shape)))
    added = motor_field(samples, samples.air, air, ground)
    fields = [motor_field(samples, part, fit, ground) for part, fit in zip(parts, (first, second), strict=True)]
    one, two = (None if field is None else field.at(samples) for field in fields)
    return CompassStudy(
        samples,
        air,
        before,
        after,
        ground,
        _steady(air, first, second),
        _cause(samples) if air.counts else "offset",
        proof,
        added,
        None if one is None or two is None else crossed(samples, parts, (one, two)),
    )


def motor_field(samples: FieldSamples, use: Mask, air: OffsetFit, ground: OffsetFit | None) -> MotorField | None:
    """The field of the motors by two points, the ground and the fit ``air`` of the samples ``use``.

    None without ground or power, or where that hardly differs.
    """
    if ground is None or not np.isfinite(samples.hover):
        return None
    on_ground = samples.mean_power(samples.before | samples.after)
    power = samples.mean_power(use) - on_ground
    if not power > 0.5 * samples.hover:
        return None
    added = air.offset - ground.offset
    still = ground.offset - added / power * on_ground
    sigma = np.hypot(air.sigma, ground.sigma)
    return MotorField(added / power, added, sigma, power, still if ground.counts else np.zeros(3))


def _steady(whole: OffsetFit, one: OffsetFit, two: OffsetFit) -> bool:
    limit = np.maximum(HALVES_SHARE * whole.size, HALVES_SIGMAS * whole.sigma)
    return bool(np.all(np.abs(one.offset - two.offset) <= limit))


def _cause(samples: FieldSamples) -> Cause:
    """What alone explains the field in flight."""
    use = samples.air
    found = one_fault.simplest(samples.t[use], samples.expected[use], samples.measured[use], samples.seconds)
    if found is None or not found.one_fault:
        return "neither"
    return "offset" if abs(found.turn_deg) <= one_fault.TURNED_DEG else "turn"
