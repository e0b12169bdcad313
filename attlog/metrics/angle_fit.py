"""How late is an estimate in step events? Angle fit over delay, gain and one offset per event.

For each event both attitudes are taken relative to their own attitude at mid-step, a
constant body misalignment of the log is removed, and the rotation is projected on the
event's own axis. Minimised over delay, gain and offsets:

    sum_i ( th_est(t_i + tau) - c_event - k th_ref(t_i) )^2

All fits (per axis, together, with one event left out) come from the same sums per
event and delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.metrics import interval
from attlog.metrics.event_pairs import RANGE_S, Pair, Track, compared, is_slower, misalignment, on_axis, relative
from attlog.metrics.steps import AXES, Event

Array = NDArray[np.float64]

COARSE_S, FINE_S = 0.010, 0.001
NEAR_S = 0.012
WIDE_S = 0.040
"""How far a fit with one event left out may move."""
PARABOLA_S = 0.006


@dataclass(slots=True)
class Sums:
    """Centred sums per event and delay, (events, delays)."""

    xx: Array
    xy: Array
    yy: Array
    count: Array


@dataclass(slots=True)
class Fit:
    """Delay (s, positive: the estimate is late), gain, and what is left.

    ``distortion`` is the residual RMS over the RMS of the reference's excursion,
    ``shape_s`` the residual RMS over the reference's rate RMS. ``each`` are the delays of
    the single events, ``offsets`` their constants c (deg), ``body`` the misalignment that
    was taken out (rad), ``table`` the sums of ``pairs`` at the delays ``grid``. ``at_edge``
    marks a minimum at the end of the range of +-250 ms.
    """

    delay: float
    gain: float
    distortion: float
    residual_deg: float
    shape_s: float
    seconds: float
    each: Array
    delay_ci95: interval.Interval | None = None
    gain_ci95: interval.Interval | None = None
    distortion_ci95: interval.Interval | None = None
    at_edge: bool = False
    offsets: Array = field(default_factory=lambda: np.zeros(0))
    body: Array = field(default_factory=lambda: np.zeros(3))
    pairs: list[Pair] = field(default_factory=list)
    table: Sums = field(default_factory=lambda: Sums(*(np.zeros((0, 0)) for _ in range(3)), np.zeros(0)))
    grid: Array = field(default_factory=lambda: np.zeros(0))
    slow: bool = False

    @property
    def events(self) -> int:
        """How many events stand behind it."""
        return len(self.pairs)


def sums(found: list[Pair], delays: Array, slow_row: bool) -> Sums:
    """Centred sums of reference x and estimate y for each event and delay.

    With ``slow_row`` the reference is interpolated to the row's own times.
    """
    shape = (len(found), len(delays))
    out = Sums(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(len(found)))
    for k, p in enumerate(found):
        if slow_row:
            use = (p.t_est >= p.event.begin) & (p.t_est <= p.event.end)
            y = np.broadcast_to(p.est[use], (len(delays), int(use.sum())))
            x = np.interp(p.t_est[use][None, :] - delays[:, None], p.t_ref, p.ref)
        else:
            use = (p.t_ref >= p.event.begin) & (p.t_ref <= p.event.end)
            x = np.broadcast_to(p.ref[use], (len(delays), int(use.sum())))
            y = np.interp(p.t_ref[use][None, :] + delays[:, None], p.t_est, p.est)
        x = x - x.mean(axis=1, keepdims=True)
        y = y - y.mean(axis=1, keepdims=True)
        out.xx[k], out.xy[k], out.yy[k] = np.sum(x * x, 1), np.sum(x * y, 1), np.sum(y * y, 1)
        out.count[k] = use.sum()
    return out


def best_delay(delays: Array, squares: Array) -> float:
    """Where the sum of squares is smallest: the minimum on the 1 ms grid, refined by a parabola over +-6 ms."""
    low, reach = int(np.argmin(squares)), round(PARABOLA_S / FINE_S)
    if low < reach or low + reach >= len(delays):
        return float(delays[low])
    u = np.arange(-reach, reach + 1) * FINE_S
    near = squares[low - reach : low + reach + 1]
    u2, u4 = np.mean(u**2), np.mean(u**4)
    curve = (np.mean(u**2 * near) - u2 * np.mean(near)) / (u4 - u2**2)
    if curve <= 0:
        return float(delays[low])
    return float(delays[low] + np.clip(-np.mean(u * near) / u2 / (2 * curve), -PARABOLA_S, PARABOLA_S))


def fit(est: Track, ref: Track, events: list[Event], body: Array | None = None) -> Fit | None:
    """The joint least-squares delay, gain and distortion of an estimate over events; None where none is covered.

    ``body`` is the misalignment of the log (rad); found from these events if not given.
    Intervals: delete-one-event jackknife, t with events - 1.
    """
    slow = is_slower(est.step, ref.step)
    moves = relative(est, ref, events, 0.0)
    found = on_axis(moves, np.zeros(3) if body is None else body, est.step, ref.step)
    if not found:
        return None
    grid = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
    delay = float(grid[int(np.argmin(_residual(sums(found, grid, slow))))])
    at_edge = abs(delay) >= RANGE_S - 1e-9
    used = np.zeros(3) if body is None else body
    for reach in (NEAR_S, WIDE_S):
        moves = relative(est, ref, events, delay)
        used = misalignment(moves, delay, slow) if body is None else body
        found = on_axis(moves, used, est.step, ref.step)
        if not found:
            return None
        grid = delay + np.arange(-round(reach / FINE_S), round(reach / FINE_S) + 1) * FINE_S
        table = sums(found, grid, slow)
        delay = best_delay(grid, _residual(table))
    out = _with_intervals(found, table, grid, delay, slow)
    out.body = used
    out.at_edge = at_edge or abs(delay) >= RANGE_S - 1e-3
    return out


def by_axis(est: Track, ref: Track, events: list[Event]) -> dict[str, Fit]:
    """Fits of all events together (``all``) and of each axis that has some, with the same body misalignment.

    An axis shares the sums of the joint fit unless its own minimum lies outside their delays.
    """
    together = fit(est, ref, events)
    if together is None:
        return {}
    fits, edge = {"all": together}, round(PARABOLA_S / FINE_S)
    for axis, name in enumerate(AXES):
        own = [k for k, pair in enumerate(together.pairs) if pair.event.axis == axis]
        if not own:
            continue
        table = _rows(together.table, own)
        low = int(np.argmin(_residual(table)))
        if together.at_edge or not edge <= low < len(together.grid) - edge:
            found = fit(est, ref, [e for e in events if e.axis == axis], together.body)
        else:
            delay = best_delay(together.grid, _residual(table))
            found = _with_intervals([together.pairs[k] for k in own], table, together.grid, delay, together.slow)
            found.body = together.body
        if found is not None:
            fits[name] = found
    return fits


def _with_intervals(found: list[Pair], table: Sums, grid: Array, delay: float, slow: bool) -> Fit:
    each = np.array([best_delay(grid, _residual(_rows(table, [k]))) for k in range(len(found))])
    at = sums(found, np.array([delay]), slow)
    out = _describe(found, at, delay, each, slow)
    out.table, out.grid, out.slow = table, grid, slow
    if len(found) >= 3:
        left_out = [best_delay(grid, _residual(_without(table, k))) for k in range(len(found))]
        numbers = np.array([_gain_and_distortion(_without(at, k)) for k in range(len(found))])
        out.delay_ci95 = interval.of_jackknife(delay, left_out)
        out.gain_ci95 = interval.of_jackknife(out.gain, numbers[:, 0])
        spread = interval.of_jackknife(out.distortion, numbers[:, 1])
        out.distortion_ci95 = None if spread is None else (max(spread[0], 0.0), spread[1])
    return out


def _describe(found: list[Pair], at: Sums, delay: float, each: Array, slow: bool) -> Fit:
    gain, distortion = _gain_and_distortion(at)
    residual = math.sqrt(float(_residual(at)[0]) / float(at.count.sum()))
    seconds, squares, offsets = 0.0, 0.0, []
    for p in found:
        t, x, y = compared(p, delay, slow)
        squares += float(np.sum(np.diff(x) ** 2 / np.maximum(np.diff(t), 1e-9)))
        seconds += float(t[-1] - t[0])
        offsets.append(float(np.mean(y) - gain * np.mean(x)))
    rate = math.sqrt(squares / seconds) if seconds > 0 else 0.0
    shape = residual / rate if rate > 0 else math.inf
    return Fit(delay, gain, distortion, residual, shape, seconds, each, offsets=np.array(offsets), pairs=found)


def _residual(s: Sums) -> Array:
    xx, xy, yy = s.xx.sum(axis=0), s.xy.sum(axis=0), s.yy.sum(axis=0)
    return np.maximum(yy - xy**2 / np.maximum(xx, 1e-30), 0.0)


def _gain_and_distortion(s: Sums) -> tuple[float, float]:
    xx, xy = float(s.xx.sum()), float(s.xy.sum())
    return xy / max(xx, 1e-30), math.sqrt(float(_residual(s)[0]) / max(xx, 1e-30))


def _rows(s: Sums, which: Any) -> Sums:
    return Sums(s.xx[which], s.xy[which], s.yy[which], s.count[which])


def _without(s: Sums, k: int) -> Sums:
    return _rows(s, np.arange(len(s.count)) != k)
