"""What GNSS and the IMU of a log say of the heading of an attitude in flight: the arrays for the evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.evidence.gnss_heading import HeadingOffset, both
from attlog.flight.model import FlightLog, Imu
from attlog.reference.compare import interpolate
from attlog.reference.physics import sensor_faults
from attlog.reference.smoothed import smoothable
from attlog.segments import Segments, gaps
from attlog.segments.spans import Span, complement, intersect

Array = NDArray[np.float64]
FIX_3D = 3


@dataclass(frozen=True, slots=True, eq=False)
class GnssMotion:
    """Specific force (n, 3) m/s^2 at ``t`` (n,) s, velocities (m, 3) m/s NED of 3D fixes, and when they count."""

    t: Array
    acc: Array
    fixes_t: Array
    velocity: Array
    spans: list[Span]

    def offsets(
        self, t: Array, q: Array, segment: NDArray[np.int64], since: float = -np.inf, spans: list[Span] | None = None
    ) -> tuple[HeadingOffset, list[HeadingOffset]]:
        """The heading error of attitudes (n, 4) at ``t`` (n,) over the flight, and of each 30 s.

        ``segment`` (n,) changes where the attitude is not to be interpolated. ``since`` s it counts, within ``spans``.
        """
        q = q if t is self.t else interpolate(t, q, segment, self.t)[0]
        counted = intersect(self.spans, [(since, np.inf)])
        counted = counted if spans is None else intersect(counted, spans)
        return both(self.t, self.acc, q, self.fixes_t, self.velocity, np.array(counted).reshape(-1, 2))


def motion_of(log: FlightLog, segments: Segments, imu: Imu | None = None) -> GnssMotion | None:
    """The motion that a log shows in flight, up to a blow; anywhere where it tells of no flight. None without GNSS.

    ``imu`` is the unit that is taken, that which is replayed where it is None. None, too, where the replayed
    accelerometer's axes are wrong: turned force shows every heading wrong.
    """
    imu = imu or log.replay_imu
    receiver = next((g for g in log.gnss if np.count_nonzero(g.fix >= FIX_3D) > 1), None)
    if imu is None or receiver is None or (imu is log.replay_imu and sensor_faults.wrong_frame(log, segments)):
        return None
    fixes_t, velocity = gaps.rising(np.where(receiver.fix >= FIX_3D, receiver.t, np.nan), receiver.vel_ned)
    if len(fixes_t) < 2:
        return None
    flown, whole = segments.spans("airborne"), smoothable(log, segments)
    spans = intersect(whole, flown) if flown else whole
    spans = intersect(spans, complement(_clipped(log, imu), -np.inf, np.inf))
    return GnssMotion(imu.gyro.t_best, imu.acc.x, fixes_t, velocity, spans)


def _clipped(log: FlightLog, imu: Imu) -> list[Span]:
    """When the accelerometer was at the end of its range: what it shows then is no force."""
    found: list[Span] = []
    for clipping in log.clippings:
        if clipping.sensor == "accelerometer" and clipping.unit in (None, imu.index):
            k = np.flatnonzero(clipping.new > 0)
            found += zip(clipping.t[np.maximum(k - 1, 0)].tolist(), clipping.t[k].tolist(), strict=True)
    return found
