"""Common gyro bias, subtracted for all filters before they run.

A raw gyro has a bias of up to some deg/s, for which no attitude filter is made: the filter that happens to estimate the
largest bias would win. Like an autopilot's calibration at rest, the mean rate of the last rest before take-off (of the
first rests if nothing flew) is subtracted, or the bias that the onboard estimator subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.plain import IN_JSON
from attlog.core.spans import Span, between, intersect
from attlog.flight.model import FlightLog, Imu, Stream
from attlog.metrics import statistics
from attlog.segments import model
from attlog.segments.model import Segments

Array = NDArray[np.float64]
Choice = Literal["rest", "none", "onboard"]
# Rising times (n,) s and finite vectors (n, 3).
Samples = tuple[Array, Array]

# Longest rest used, nearest to take-off; the remaining rest can still show a drift.
MAX_REST_S = 30.0
SHORTEST_S = 1.0  # less rest gives no bias
# Length of blocks for the interval; shorter ones if there are fewer than four.
BLOCK_S, MIN_BLOCKS = 1.0, 4
# Smallest predicted turn of a vector that tests whether the vehicle turned.
MIN_TURN_DEG = 3.0
TURNED_SHARE = 0.3  # observed over predicted turn of gravity or field, above which the vehicle turned
# Largest predicted turn: a full turn looks like none.
MAX_TURN_DEG = 90.0


@dataclass(slots=True)
class CommonBias:
    """Gyro bias (body axes, FRD) common to all replays of an IMU.

    ``asked``: the option; ``taken``: the one used; ``why``: reason of a difference. ``dps`` (3): deg/s, for ``onboard``
    the mean over the log. ``half95_dps`` (3): half the 95 % interval over ``seconds`` s of rest between ``t0_s`` and
    ``t1_s``, without changes in flight. ``landed_dps`` (3): mean rate of the rests after the flight. ``flew``: the rest
    ends before a take-off. ``steps_dps`` (3): steps of a gyro whose readings are cut towards zero, and to which half a
    step was added before; ``steps_seen_s``: time of the reading that showed it.
    """

    asked: Choice
    taken: Choice
    imu: str = ""
    dps: list[float] | None = None
    half95_dps: list[float] | None = None
    seconds: float | None = None
    t0_s: float | None = None
    t1_s: float | None = None
    landed_dps: list[float] | None = None
    why: str = ""
    flew: bool = False
    steps_dps: list[float] | None = None
    steps_seen_s: float | None = None
    # For ``onboard``: times (m,) s and values (m, 3) rad/s, each valid until the next.
    over_time: tuple[Array, Array] | None = field(default=None, repr=False, metadata={IN_JSON: False})

    def at(self, t: Array) -> Array:
        """Return the subtracted bias (n, 3) in rad/s at times ``t`` (n,)."""
        if self.over_time is not None:
            known, x = self.over_time
            return np.asarray(x[np.maximum(np.searchsorted(known, t, side="right") - 1, 0)])
        return np.broadcast_to(np.zeros(3) if self.dps is None else np.radians(self.dps), (len(t), 3))


def no_common_bias(why: str = "") -> CommonBias:
    """Return a bias of zero."""
    return CommonBias("none", "none", why=why)


def common_bias(log: FlightLog, segments: Segments, imu: Imu, asked: Choice) -> CommonBias:
    """Return the bias for the replay of an IMU by option."""
    found = (
        no_common_bias() if asked == "none" else _onboard(log, imu) if asked == "onboard" else _rest(log, segments, imu)
    )
    found.asked, found.imu = asked, imu.gyro.source
    if imu.truncation is not None:
        found.steps_dps = [float(v) for v in np.degrees(imu.truncation.step)]
        found.steps_seen_s = float(imu.gyro.t[imu.truncation.readings - 1])
    return found


def _onboard(log: FlightLog, imu: Imu) -> CommonBias:
    stream = log.estimator.gyro_bias
    if imu is not log.replay_imu:
        return no_common_bias("the onboard estimator's bias belongs to another IMU")
    good = np.zeros(0, bool) if stream is None else rotation.finite_rows(stream.x) & np.isfinite(stream.t)
    if stream is None or not good.any():
        return no_common_bias("the log holds no onboard gyro bias for the replayed gyro")
    order = np.argsort(stream.t[good], kind="stable")
    t, x = stream.t[good][order], stream.x[good][order]
    mean = [float(v) for v in np.degrees(np.mean(x, axis=0))]
    return CommonBias("onboard", "onboard", dps=mean, t0_s=float(t[0]), t1_s=float(t[-1]), over_time=(t, x))


def _rest(log: FlightLog, segments: Segments, imu: Imu) -> CommonBias:
    t, x = model.select_rising(imu.gyro.t_best, imu.gyro.x)
    takeoff, landing = _flight(segments)
    rests = segments.spans("rest")
    before = intersect(rests, [(-np.inf, takeoff)])
    seen = _vectors(log, imu)
    still = [span for span in before if not turned((t, x), seen, span)]
    chosen = _nearest(still, latest=np.isfinite(takeoff))
    inside = [between(t, a, b) for a, b in chosen]
    seconds = sum(b - a for a, b in chosen)
    if seconds < SHORTEST_S or not any(_enough(m) for m in inside):
        other = (
            "; --gyro-bias onboard would subtract the autopilot's own" if log.estimator.gyro_bias is not None else ""
        )
        return no_common_bias(_why_no_rest(before, rests, np.isfinite(takeoff)) + other)
    means = np.degrees(np.concatenate([_blocks(t[m], x[m]) for m in inside if _enough(m)]))
    mean = np.degrees(np.mean(np.concatenate([x[m] for m in inside]), axis=0))
    half = [
        0.5 * (ends[1] - ends[0]) for ends in (statistics.mean_interval(axis) for axis in means.T) if ends is not None
    ]
    later = intersect(rests, [(landing, np.inf)]) if np.isfinite(landing) else []
    landed = np.concatenate([np.zeros((0, 3)), *(x[between(t, a, b)] for a, b in later)])
    return CommonBias(
        "rest",
        "rest",
        dps=[float(v) for v in mean],
        half95_dps=[float(v) for v in half] if len(half) == 3 else None,
        seconds=float(seconds),
        t0_s=float(chosen[0][0]),
        t1_s=float(chosen[-1][1]),
        landed_dps=[float(v) for v in np.degrees(np.mean(landed, axis=0))] if len(landed) else None,
        flew=bool(np.isfinite(takeoff)),
    )


def _flight(segments: Segments) -> Span:
    """Return first take-off and last landing, s; infinite without flight."""
    flown = segments.spans("airborne")
    return (flown[0][0], flown[-1][1]) if flown else (np.inf, np.inf)


def _nearest(spans: list[Span], latest: bool) -> list[Span]:
    """Return up to MAX_REST_S of the latest or first spans, in order."""
    left, found = MAX_REST_S, []
    for a, b in reversed(spans) if latest else spans:
        length = min(b - a, left)
        if length <= 0.0:
            break
        found.append((b - length, b) if latest else (a, a + length))
        left -= length
    return sorted(found)


def _blocks(t: Array, x: Array) -> Array:
    """Return means (k, 3) over blocks of 1 s, at least four."""
    k = min(max(int((t[-1] - t[0]) / BLOCK_S), MIN_BLOCKS), len(t))
    return np.array([part.mean(axis=0) for part in np.array_split(x, k)])


def _why_no_rest(before: list[Span], rests: list[Span], flew: bool) -> str:
    if before:
        return "what looks like rest before take-off is a steady turn: gravity or field turn with the gyro"
    if rests and flew:
        return "the log holds no rest before take-off, only after it"
    return "the log holds no rest" + (" before take-off" if flew else "")


def _enough(inside: slice) -> bool:
    """Return whether there is a sample for each block."""
    return bool(inside.stop - inside.start >= MIN_BLOCKS)


def _vectors(log: FlightLog, imu: Imu) -> list[Samples]:
    """Return specific force and field, which reveal a rotation without the gyro."""
    streams: list[Stream] = [imu.acc] if log.mag is None else [imu.acc, log.mags[log.mag].field]
    known = [(s.t_best, s.x, s.x.any(axis=1)) for s in streams]
    return [model.select_rising(t[there], x[there]) for t, x, there in known]


def turned(gyro: Samples, vectors: list[Samples], span: Span) -> bool:
    """Return whether gravity or field turned with the gyro.

    A steady turn, as of a boat at anchor, otherwise looks like rest.
    """
    inside = between(gyro[0], *span)
    if not _enough(inside):
        return False
    rate = np.mean(gyro[1][inside], axis=0)
    return any(_follows(at, v, rate, span) for at, v in vectors)


def _follows(t: Array, v: Array, rate: Array, span: Span) -> bool:
    """Return whether vectors (n, 3) turn as the constant ``rate`` (3,) predicts."""
    size = float(np.sqrt(rate @ rate))
    length = min(span[1] - span[0], np.radians(MAX_TURN_DEG) / max(size, 1e-9))
    ends = [between(t, a, a + 0.2 * length) for a in (span[0], span[0] + 0.8 * length)]
    if any(end.stop <= end.start for end in ends):
        return False
    first, last = (np.mean(v[end], axis=0) for end in ends)
    seconds = float(np.mean(t[ends[1]]) - np.mean(t[ends[0]]))
    wanted = rotation.rotate(rotation.from_rotvec(-rate * seconds), first) - first
    square = float(wanted @ wanted)
    if square < float(first @ first) * np.radians(MIN_TURN_DEG) ** 2:
        return False
    return float((last - first) @ wanted) / square > TURNED_SHARE
