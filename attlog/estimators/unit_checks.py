"""Warnings about samples in other units or axes than :func:`attlog.estimate` takes: s, rad/s, m/s^2, FRD.

Filters run on any numbers; a factor of 57 in the gyro or of 10^6 in the times makes an attitude that looks like one.
Each check asks physics: how often an inertial unit is read, how large gravity is, and whether gravity stays where it is
while the gyro turns the body. Nothing is converted.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median

Array = NDArray[np.float64]

# Fewest samples that are judged.
MIN_SAMPLES = 100
# Median interval in s above which no inertial unit is read, and the rates in Hz at which they are.
MAX_INTERVAL_S, RATES_HZ = 0.75, (4.0, 10_000.0)
# Units of time and their size in s.
TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Median specific force in m/s^2 of a body that is not always falling or circling, and units by their size.
FORCE_M_S2 = (4.0, 40.0)
FORCE_UNITS = {"g": 9.80665, "mg": 9.80665e-3, "cm/s^2": 1e-2}
# Share of its size that gravity has along one axis of a body at level, and the share of samples that show it.
LEVEL, LEVEL_SHARE = 0.8, 0.8
# Windows in which the specific force is turned to earth: length, most windows, and steps of integration.
WINDOW_S, MAX_WINDOWS, STEP_S = 10.0, 8, 0.05
# Coherence: mean length of the force turned to earth over its mean length. Rows of the least mean deviation of the gyro
# from its median in rad/s, the largest coherence, and its least rise without the factor of 57. On 108 flights, benches
# and hands in rad/s the deviation is up to 3.4 (turned by hand), the coherence 0.72 to 1 (turning planes 0.8); with the
# gyro in deg/s the coherence of most flights is below 0.55. A body that turns by 8 rad/s on average does not fly.
WRONG_RATES = ((0.5, 0.55, 0.25), (4.0, 0.95, 0.03), (8.0, 1.0, 0.0))
# Coherence without that factor, which a body shows that hardly turns.
MIN_COHERENCE_DEG = 0.8
# Deviation from the median that no flight in deg/s exceeds.
MAX_DEVIATION_DEG_S = 150.0


class UnitWarning(UserWarning):
    """Warning about samples that look as if they had another unit, or other axes, than a function takes.

    Nothing is converted. ``warnings.simplefilter("error", attlog.UnitWarning)`` makes it an error.
    """


def warn_of_units(t: Any, gyr: Any, acc: Any, stacklevel: int = 3) -> None:
    """Issue a :class:`UnitWarning` for each array that is probably in another unit.

    ``t`` (n,) taken as s, ``gyr`` (n, 3) as rad/s, ``acc`` (n, 3) as m/s^2 or None. Arrays of other shapes are left to
    the checks of the filter's input.
    """
    try:
        times, rates = np.asarray(t, np.float64), np.asarray(gyr, np.float64)
        force = None if acc is None else np.asarray(acc, np.float64)
    except (TypeError, ValueError):
        return
    if times.ndim != 1 or rates.shape != (len(times), 3) or (force is not None and force.shape != rates.shape):
        return
    for text in unit_doubts(times, rates, force):
        warnings.warn(text, UnitWarning, stacklevel=stacklevel)


def unit_doubts(t: Array, gyr: Array, acc: Array | None) -> list[str]:
    """Return a sentence for each array that is probably in another unit."""
    good = np.isfinite(t) & rotation.finite_rows(gyr)
    if acc is not None:
        good &= rotation.finite_rows(acc)
    if np.count_nonzero(good) < MIN_SAMPLES:
        return []
    if not good.all():
        t, gyr, acc = t[good], gyr[good], None if acc is None else acc[good]
    found = [time_doubt(t)]
    if acc is not None:
        found.append(force_doubt(acc))
        if not found[0]:
            found.append(rate_doubt(t, gyr, acc))
    return [text for text in found if text]


def time_doubt(t: Array) -> str:
    """Return why times (n,) are probably not in s; empty if they may be."""
    step = float(median(np.diff(t)))
    if step <= MAX_INTERVAL_S:
        return ""
    unit = next((u for u, size in TIME_UNITS.items() if RATES_HZ[0] <= 1.0 / (size * step) <= RATES_HZ[1]), "")
    if not unit:
        return ""
    return (
        f"t is taken in s, and its median interval is {step:.6g}: it looks like {unit}; give t * {TIME_UNITS[unit]:g}"
    )


def force_doubt(acc: Array) -> str:
    """Return why specific forces (n, 3) are probably not in m/s^2, FRD; empty if they may be."""
    size = rotation.length(acc)
    middle = float(median(size))
    if middle == 0.0:
        return ""
    if not FORCE_M_S2[0] <= middle <= FORCE_M_S2[1]:
        unit = next((u for u, one in FORCE_UNITS.items() if 0.75 <= middle * one / 9.80665 <= 1.5), "")
        looks = f"it looks like {unit}; give acc * {FORCE_UNITS[unit]:g}" if unit else "gravity alone is 9.8"
        return f"acc is taken in m/s^2, and its median length is {middle:.4g}: {looks}"
    if np.mean(acc[:, 2] > LEVEL * size) > LEVEL_SHARE:
        return (
            "acc is taken as specific force in FRD, where a level body reads z = -9.8, and its z is mostly "
            f"{float(median(acc[:, 2])):+.1f}: axes of FLU, or gravity in place of specific force; turn gyr and acc"
        )
    return ""


def rate_doubt(t: Array, gyr: Array, acc: Array) -> str:
    """Return why angular rates (n, 3) are probably not in rad/s; empty if they may be.

    Turned to earth by the gyro, the specific force keeps its direction over some seconds, because velocity does not
    grow for ever. Turned by rates that are too large it is scattered; in a body that hardly turns it keeps its
    direction without being turned at all, which shows that the rates are to blame.
    """
    bias = median(gyr, axis=0)
    size = rotation.length(gyr - bias)
    deviation = float(np.mean(size))
    rows = [row for row in WRONG_RATES if deviation >= row[0]]
    if not rows or t[-1] - t[0] < WINDOW_S:
        return ""
    windows = _busiest_windows(t, size)
    if not len(windows):
        return ""
    as_given, in_degrees = (_coherence(t, gyr - bias, acc, windows, scale) for scale in (1.0, np.pi / 180.0))
    if in_degrees < MIN_COHERENCE_DEG or not any(as_given <= c and in_degrees >= as_given + r for _, c, r in rows):
        return ""
    unit = "deg/s; give np.radians(gyr)" if deviation < MAX_DEVIATION_DEG_S else "raw counts or mrad/s; convert it"
    return f"gyr is taken in rad/s, and gravity does not follow its turns: it looks like {unit}"


def _busiest_windows(t: Array, size: Array) -> Array:
    """Return the starts (k,) of the windows in which the gyro deviates most."""
    window = (t - t[0]) // WINDOW_S
    keep = (window >= 0.0) & (window < window[-1])
    # Only windows that hold samples: a stray time after years is no reason to count the windows before it.
    present, index = np.unique(window[keep], return_inverse=True)
    mean = np.bincount(index, size[keep]) / np.maximum(np.bincount(index), 1)
    return np.asarray(t[0] + WINDOW_S * np.sort(present[np.argsort(mean)[-MAX_WINDOWS:]]))


def _coherence(t: Array, gyr: Array, acc: Array, windows: Array, scale: float) -> float:
    """Return the mean force in earth axes over its mean length, median of windows; 1 where it keeps its direction."""
    steps = round(WINDOW_S / STEP_S)
    sums, counts = np.zeros((len(windows), steps, 6)), np.zeros((len(windows), steps))
    for k, start in enumerate(windows):
        inside = slice(*np.searchsorted(t, [start, start + WINDOW_S]))
        part = np.clip(((t[inside] - start) / STEP_S).astype(np.int64), 0, steps - 1)
        counts[k] = np.bincount(part, minlength=steps)
        for i, x in enumerate((*gyr[inside].T, *acc[inside].T)):
            sums[k, :, i] = np.bincount(part, x, minlength=steps)
    means = sums / np.maximum(counts, 1.0)[..., None]
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(windows), 1))
    turns = rotation.from_rotvec((scale * STEP_S * means[..., :3]).reshape(-1, 3)).reshape(len(windows), steps, 4)
    total = np.zeros((len(windows), 3))
    for k in range(steps):
        total += rotation.rotate(q, means[:, k, 3:])
        q = rotation.multiply(q, turns[:, k])
    lengths = rotation.length(means[..., 3:].reshape(-1, 3)).reshape(len(windows), steps).sum(axis=1)
    return float(median(rotation.length(total) / np.maximum(lengths, 1e-12)))
