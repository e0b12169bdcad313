"""What one compass read in the air and on the ground, beside the earth's field as the motion attitude turns it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.earth import MagneticField
from attlog.flight.model import FlightLog, Mag, Stream, TimeLine
from attlog.health.assessments.model import Array, HealthCase, MotionAttitude
from attlog.health.sensors import interference
from attlog.health.sound import UPSIDE_DOWN_DEG, crashed
from attlog.segments.model import Segments
from attlog.segments.spans import Span, inside

Mask = NDArray[np.bool_]
Power = Literal["current", "throttle"]

EDGE_S = 1.0
"""Left out at both ends of a flight: the vehicle is near the ground, and its attitude is that of a take-off."""
GROUND_S = 20.0
"""So long before take-off and after landing the vehicle counts as standing where it took off or landed."""
IDLE = 0.25
"""Below this share of the power in flight motors bend no field that matters."""
SURE = np.radians(5.0)
"""Samples count where the motion attitude says that its heading is known to this (one sigma)."""
MOST = 2000
"""Samples in flight that are compared: errors of an attitude last for seconds, and a long log must cost little more."""
NEAR_S = 2.0
"""A record of power further away than this from a sample of the field says nothing of it."""
LEAST_GROUND, LEAST_GROUND_S = 10, 2.0
LEAST_AMPERE = 0.5
"""A current that never exceeds this is that of a sensor that is not there."""


@dataclass(frozen=True, slots=True)
class FieldSamples:
    """Samples of one compass at ``t`` (n,) s, some of the ``air``, some ``before`` take-off, some ``after`` landing.

    ``measured`` and ``expected`` (n, 3) uT in body axes: the logged field, and the earth's (``earth``, (3,) uT NED)
    turned by the attitude ``q`` (n, 4). ``sigma_heading`` (n,) rad is what the attitude says of its heading. ``power``
    (n,) is the battery's current in A or the throttle (0 to 1), as ``power_kind`` says, NaN where unknown; ``hover``
    its median in the air, NaN where no power is logged. ``seconds`` in the air.
    """

    mag: Mag
    t: Array
    measured: Array
    expected: Array
    q: Array
    sigma_heading: Array
    power: Array
    air: Mask
    before: Mask
    after: Mask
    earth: Array
    hover: float
    power_kind: Power
    seconds: float

    @property
    def source(self) -> str:
        """The compass as the log calls it."""
        return self.mag.field.source

    @property
    def error(self) -> Array:
        """What the compass reads too much (n, 3), uT in body axes."""
        return self.measured - self.expected

    def mean_power(self, use: Mask) -> float:
        """The median power of some samples; 0 where none is known there, as with motors that never ran."""
        known = self.power[use & np.isfinite(self.power)]
        return float(np.median(known)) if len(known) else 0.0


def gathered(case: HealthCase, mag: Mag, motion: MotionAttitude, model: MagneticField) -> FieldSamples | None:
    """Samples of ``mag`` where the ``motion`` attitude knows its heading; None where the flight holds none."""
    assert case.segments is not None
    t, field = mag.field.t_best, 1e6 * mag.field.x
    flown = air_spans(case.segments)
    good = rotation.finite(field) & np.isfinite(t)
    air = _thinned(good & inside(t, flown), MOST)
    kind, drive = drive_of(case.log)
    hover = _median(power_at(drive, t[air]))
    before, after = ground_spans(case.segments)
    on_ground = [_thinned(good & inside(t, spans), MOST // 5) for spans in (before, after)]
    wanted = air | on_ground[0] | on_ground[1]
    where = np.flatnonzero(wanted)
    q, sample = rotation.interpolated(motion.t, motion.q, motion.segment, t[where])
    sigma = motion.sigma_heading[np.clip(sample, 0, len(motion.t) - 1)]
    known = rotation.finite(q) & (sigma <= SURE)
    known[known] &= np.degrees(rotation.inclination_angle(q[known])) < UPSIDE_DOWN_DEG
    where, q, sigma = where[known], q[known], sigma[known]
    if not air[where].any():
        return None
    earth = 1e6 * np.array(model.ned_t)
    power = power_at(drive, t[where])
    idle = _idle(case.log.armed, t[where], power, hover)
    share = np.count_nonzero(air[where]) / int(np.count_nonzero(air))
    standing = [_enough(t[where], mask[where] & idle) for mask in on_ground]
    return FieldSamples(
        mag=mag,
        t=t[where],
        measured=field[where],
        expected=rotation.rotate_inverse(q, earth),
        q=q,
        sigma_heading=sigma,
        power=power,
        air=air[where],
        before=standing[0],
        after=standing[1],
        earth=earth,
        hover=hover,
        power_kind=kind,
        seconds=share * sum(b - a for a, b in flown),
    )


def air_spans(segments: Segments) -> list[Span]:
    """When the vehicle flew, less EDGE_S at both ends, up to the first crash."""
    end = min((span[0] for span in crashed(segments)), default=np.inf)
    spans = [(a + EDGE_S, min(b, end) - EDGE_S) for a, b in segments.spans("airborne")]
    return [(a, b) for a, b in spans if b > a]


def ground_spans(segments: Segments) -> tuple[list[Span], list[Span]]:
    """Up to GROUND_S before the first take-off, and after the last landing unless something crashed."""
    flown = segments.spans("airborne")
    if not flown:
        return [], []
    end = min((span[0] for span in crashed(segments)), default=np.inf)
    first, last = flown[0][0], flown[-1][1]
    return [(first - GROUND_S, first)], [(last, last + GROUND_S)] if end == np.inf else []


def drive_of(log: FlightLog) -> tuple[Power, Stream | None]:
    """What tells of the motors' power: the battery's current, else the throttle."""
    for what, stream, _ in interference.drives(log):
        if what.endswith("current") and np.nanmax(np.abs(stream.x[:, 0])) < LEAST_AMPERE:
            continue
        return ("current" if what.endswith("current") else "throttle"), stream
    return "throttle", None


def power_at(drive: Stream | None, t: Array) -> Array:
    """The power (n,) at times ``t`` (n,) s; NaN further than NEAR_S from any record, or without one."""
    if drive is None:
        return np.full(len(t), np.nan)
    known = np.isfinite(drive.x[:, 0])
    at, x = drive.t[known], drive.x[known, 0]
    if not len(at):
        return np.full(len(t), np.nan)
    k = np.clip(np.searchsorted(at, t), 1, max(len(at) - 1, 1))
    gap = np.minimum(np.abs(t - at[k - 1]), np.abs(at[np.minimum(k, len(at) - 1)] - t))
    return np.where(gap <= NEAR_S, np.interp(t, at, x), np.nan)


def _idle(armed: TimeLine | None, t: Array, power: Array, hover: float) -> Mask:
    """Where motors stand or idle: by the power, where none is known by being disarmed."""
    off = np.zeros(len(t), bool)
    if armed is not None and len(armed.value):
        k = np.clip(np.searchsorted(armed.t, t, side="right") - 1, 0, None)
        off = ~np.array([bool(v) for v in armed.value])[k]
    if not np.isfinite(hover) or hover <= 0:
        return off
    return np.asarray(np.where(np.isfinite(power), power < IDLE * hover, off))


def _enough(t: Array, use: Mask) -> Mask:
    """The samples, none of them where they are too few to tell a field."""
    few = use.sum() < LEAST_GROUND or np.ptp(t[use]) < LEAST_GROUND_S
    return np.zeros(len(t), bool) if few else use


def _thinned(use: Mask, most: int) -> Mask:
    """At most so many of the samples, evenly over them."""
    where = np.flatnonzero(use)
    kept = np.zeros(len(use), bool)
    kept[where[:: max(1, -(-len(where) // most))]] = True
    return kept


def _median(x: Array) -> float:
    known = x[np.isfinite(x)]
    return float(np.median(known)) if len(known) else float("nan")
