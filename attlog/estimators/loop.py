"""The shared loop: it owns time, so that a filter's step sees only good numbers.

What it does with real input, once for all filters:

- a sample whose time or gyro is not finite, whose time does not rise or whose gyro is
  beyond any sensor's range is left out and counted; of times that run backwards the
  longest rising sequence is kept;
- a missing, zero or impossible accelerometer or magnetometer vector reaches the step as
  a zero vector, which asks for no correction;
- ``interval``: sample k acts over (t_{k-1}, t_k]; ``instant``: the mean of k-1 and k does;
- a gap (dt > max(5 median dt, 50 ms)) of up to 0.5 s is integrated across with the
  neighbours' mean rate; beyond, the filter restarts and ``run`` counts up;
- between samples of a slow magnetometer the last vector is turned on with the
  bias-corrected gyro for at most 1.5 nominal periods, then it is missing;
- a step that would turn by more than 1 rad is taken in parts.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog import rotation
from attlog.errors import PluginError, UsageError
from attlog.estimators import cache, generate
from attlog.estimators.base import Array, Estimate, Estimator, plugin_errors
from attlog.estimators.start import initial_state, to_true_north
from attlog.estimators.vectors import GRAVITY, turn_vector_back
from attlog.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S

Sampling = Literal["interval", "instant"]

GAP_MEDIANS, GAP_LEAST_S, BRIDGE_S = 5.0, 0.05, 0.5
HOLD_PERIODS = 1.5
MISSING, NEW, HELD = 0, 1, 2

LOOP = """
def advance(state, params, dt, parts, gyr, acc, mag, use, every, out):
    m = np.zeros(3)
    row = 0
    wait = 0
    for k in range(len(dt)):
        h = dt[k] if parts[k] == 1 else dt[k] / max(parts[k], 1)
        if use[k] == 1:
            m[0] = mag[k, 0]
            m[1] = mag[k, 1]
            m[2] = mag[k, 2]
        elif use[k] == 0:
            m[0] = 0.0
            m[1] = 0.0
            m[2] = 0.0
        for _ in range(parts[k]):
            if use[k] == 2:
                turn_vector_back(m, gyr[k, 0]{bx}, gyr[k, 1]{by}, gyr[k, 2]{bz}, h)
            step(state, params, h, gyr[k], acc[k], m)
        if wait == 0:
            for j in range({outputs}):
                out[row, j] = state[j]
            row += 1
            wait = every
        wait -= 1
"""
SIGNATURE = "void(f8[::1], f8[::1], f8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1], i8, f8[:, ::1])"


@dataclass(slots=True)
class Samples:
    """Cleaned input. ``parts`` is 0 at the first sample of a run: nothing to integrate there yet.

    ``t`` (n,), ``dt`` (n,), ``gyr`` (n, 3) effective rate over dt, ``acc`` and ``mag``
    (n, 3) with zero vectors where missing, ``use`` (n,) MISSING, NEW or HELD for the
    magnetometer, ``run`` (n,), ``begin`` first index of each run.
    """

    t: Array
    dt: Array
    parts: NDArray[np.int64]
    gyr: Array
    acc: Array
    mag: Array
    use: NDArray[np.int64]
    run: NDArray[np.int64]
    begin: NDArray[np.int64]
    skipped: dict[str, int] = field(default_factory=dict)


def prepare(
    t: ArrayLike,
    gyr: ArrayLike,
    acc: ArrayLike | None,
    mag: ArrayLike | None = None,
    *,
    dt: ArrayLike | None = None,
    sampling: Sampling = "interval",
    hold_mag: bool = True,
) -> Samples:
    """Cleaned samples for the kernels; the input is never changed. UsageError for wrong shapes."""
    if sampling not in ("interval", "instant"):
        raise UsageError(f"sampling={sampling} is not known; give interval or instant")
    t, gyr, acc, mag, own = _shapes(t, gyr, acc, mag, dt)
    skipped: dict[str, int] = {}
    t, gyr, acc, mag, own = _good_times(t, gyr, acc, mag, own, skipped)
    acc = _vectors(acc, ACC_LIMIT_M_S2, skipped, absent_is_missing=False)
    mag = _vectors(mag, np.inf, skipped, absent_is_missing=True)
    step = np.diff(t, prepend=t[:1])
    gap = step > max(GAP_MEDIANS * float(np.median(step[1:])), GAP_LEAST_S) if len(t) > 1 else np.zeros(len(t), bool)
    restart = gap & (step > BRIDGE_S)
    bridged = gap & ~restart
    first = restart.copy()
    first[:1] = True
    rate = gyr.copy()
    between = np.flatnonzero(bridged if sampling == "interval" else ~first)
    rate[between] = 0.5 * (gyr[between - 1] + gyr[between])
    if own is not None:
        trusted = np.isfinite(own) & (own > 0) & (step < 1.5 * own) & ~first
        step = np.where(trusted, own, step)
    step = np.where(first, 0.0, step)
    angle = np.sqrt(np.einsum("ij,ij->i", rate, rate)) * step
    parts = np.where(first, 0, np.maximum(np.ceil(angle), 1)).astype(np.int64)
    for name, count in (("gap_bridged", int(bridged.sum())), ("restart", int(restart.sum()))):
        if count:
            skipped[name] = count
    run = np.cumsum(restart).astype(np.int64)
    use = _mag_use(t, mag, run, hold_mag)
    return Samples(t, step, parts, rate, acc, mag, use, run, np.flatnonzero(first), skipped)


def run(
    estimator: Estimator,
    samples: Samples,
    values: Mapping[str, float | str],
    q0: ArrayLike | None = None,
    every: int = 1,
) -> Estimate:
    """The estimate of one filter on prepared samples; ``values`` are all parameters, resolved."""
    if estimator.run is not None:
        return _whole_run(estimator, samples, values, q0)
    params = estimator.pack(values)
    advance = kernel(estimator)
    bounds = np.append(samples.begin, len(samples.t)).tolist()
    chunks, kept, spent = [], [], 0.0
    for number, (a, b) in enumerate(pairwise(bounds)):
        state = initial_state(estimator, samples, a, b, params, values, q0 if number == 0 else None)
        out = np.empty((-(-(b - a) // every), estimator.outputs))
        use = samples.use[a:b]
        clock = time.perf_counter()
        advance(
            state,
            params,
            samples.dt[a:b],
            samples.parts[a:b],
            samples.gyr[a:b],
            samples.acc[a:b],
            samples.mag[a:b],
            use,
            every,
            out,
        )
        spent += time.perf_counter() - clock
        chunks.append(out)
        kept.append(np.arange(a, b, every))
    out = np.concatenate(chunks) if chunks else np.empty((0, estimator.outputs))
    rows = np.concatenate(kept) if kept else np.empty(0, np.int64)
    estimate = collect(estimator, samples, rows, out, values)
    estimate.ns_per_update = 1e9 * spent / max(len(samples.t), 1)
    return estimate


def collect(
    estimator: Estimator, samples: Samples, rows: NDArray[np.int64], out: Array, values: Mapping[str, float | str]
) -> Estimate:
    """The estimate that kernel output ``out`` (n, outputs) at sample numbers ``rows`` (n,) means."""
    aux = {name: out[:, part].copy() for name, part in estimator.slices.items()}
    return Estimate(
        t=samples.t[rows],
        q=to_true_north(np.ascontiguousarray(out[:, :4]), values),
        bias=aux.pop("bias", None),
        aux=aux,
        run=samples.run[rows],
        skipped=dict(samples.skipped),
        causal=estimator.causal,
    )


def kernel(estimator: Estimator) -> Any:
    """The loop around the estimator's step: compiled, or plain Python with ATTLOG_NO_JIT=1.

    PluginError if a plug-in's step cannot be compiled.
    """
    bias = estimator.slices.get("bias")
    b = ["" if bias is None else f" - state[{bias.start + i}]" for i in range(3)]
    loop = LOOP.format(bx=b[0], by=b[1], bz=b[2], outputs=estimator.outputs).lstrip()
    used = {"turn_vector_back": turn_vector_back, "step": estimator.step}
    twin = _quiet(cache.plain(loop, "advance", used), estimator)
    if not cache.jit_wanted():
        return twin
    decorator = f"\n\n@njit({SIGNATURE!r}, cache=KEEP, error_model='numpy')\n"
    try:
        return cache.compiled(generate.with_helpers(used, jit=True) + decorator + loop, "advance")
    except Exception as error:
        if estimator.origin == "attlog":
            raise
        _try_plainly(estimator, twin)
        reason = " ".join(str(error).split())[:400]
        raise PluginError(
            f"{estimator.origin}: step runs in Python but numba cannot compile it ({reason}); "
            "use numbers and elements of arrays only, or set ATTLOG_NO_JIT=1"
        ) from error


def _try_plainly(estimator: Estimator, twin: Any) -> None:
    """Run two samples in plain Python: what is wrong there has a line in the plug-in's file. PluginError says it."""
    vectors = np.tile([0.1, 0.2, -GRAVITY], (2, 1))
    still = Samples(
        np.array([0.0, 0.01]), np.array([0.0, 0.01]), np.array([0, 1]), 0.1 * vectors, vectors, vectors,
        np.array([NEW, NEW]), np.zeros(2, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip
    values = {p.name: p.default for p in estimator.parameters}
    params = estimator.pack(values)
    state = initial_state(estimator, still, 0, 2, params, values, None)
    out = np.empty((2, estimator.outputs))
    twin(state, params, still.dt, still.parts, still.gyr, still.acc, still.mag, still.use, 1, out)


def place(t_imu: ArrayLike, t_mag: ArrayLike, field: ArrayLike) -> Array:
    """Magnetometer samples on IMU times: (n, 3) with NaN rows where there is no new sample.

    ``t_imu`` (n,) s, ``t_mag`` (m,) s, ``field`` (m, 3) any unit. Each sample goes to the
    first IMU sample at or after it, the newest wins; samples after the last IMU time are
    dropped. UsageError for wrong shapes.
    """
    t_imu = np.asarray(t_imu, np.float64)
    t_mag = np.asarray(t_mag, np.float64)
    field = np.asarray(field, np.float64)
    if t_imu.ndim != 1 or t_mag.ndim != 1 or field.shape != (len(t_mag), 3):
        raise UsageError(
            f"place needs t_imu (n,), t_mag (m,), field (m, 3); got {t_imu.shape}, {t_mag.shape}, {field.shape}"
        )
    out = np.full((len(t_imu), 3), np.nan)
    good = np.isfinite(t_mag) & np.isfinite(field).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(t_mag[good], kind="stable")]
    finite = np.flatnonzero(np.isfinite(t_imu))
    where = np.searchsorted(t_imu[finite], t_mag[order], side="left")
    inside = where < len(finite)
    out[finite[where[inside]]] = field[order[inside]]
    return out


def _shapes(t: Any, gyr: Any, acc: Any, mag: Any, dt: Any) -> tuple[Array, Array, Array, Array, Array | None]:
    """float64 arrays of the right shapes; missing sensors become NaN rows."""
    try:
        t = np.asarray(t, np.float64)
        arrays = {
            n: None if x is None else np.asarray(x, np.float64) for n, x in (("gyr", gyr), ("acc", acc), ("mag", mag))
        }
        dt = None if dt is None else np.asarray(dt, np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"t, gyr, acc and mag must be arrays of numbers ({error})") from None
    if t.ndim != 1:
        raise UsageError(f"t must have shape (n,), not {t.shape}")
    if arrays["gyr"] is None:
        raise UsageError("gyr must have shape (n, 3), not None")
    for name, x in arrays.items():
        if x is not None and x.shape != (len(t), 3):
            raise UsageError(f"{name} must have shape ({len(t)}, 3) like t, not {x.shape}")
    if dt is not None and dt.shape != t.shape:
        raise UsageError(f"dt must have shape {t.shape} like t, not {dt.shape}")
    filled = [np.full((len(t), 3), np.nan) if x is None else x for x in arrays.values()]
    return t, filled[0], filled[1], filled[2], dt


def _good_times(
    t: Array, gyr: Array, acc: Array, mag: Array, own: Array | None, skipped: dict[str, int]
) -> tuple[Array, Array, Array, Array, Array | None]:
    """Only samples with finite, rising time and a possible rate."""
    finite = np.isfinite(t) & _whole(np.isfinite(gyr))
    with np.errstate(invalid="ignore"):
        possible = _whole(np.abs(gyr) <= GYRO_LIMIT_RAD_S)
    keep = np.flatnonzero(finite & possible)
    rising = keep[_longest_rising(t[keep])]
    lost = {
        "nan": int((~finite).sum()),
        "saturated": int((finite & ~possible).sum()),
        "time_not_rising": len(keep) - len(rising),
    }
    skipped.update({name: count for name, count in lost.items() if count})
    if len(rising) == len(t):
        return t.copy(), gyr, acc, mag, own
    return t[rising], gyr[rising], acc[rising], mag[rising], None if own is None else own[rising]


def _whole(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows (n,) of a mask (n, 3) that hold in all three columns; many times faster than ``all(axis=1)``."""
    return mask[:, 0] & mask[:, 1] & mask[:, 2]


def _longest_rising(t: Array) -> NDArray[np.int64]:
    """Indices of the longest strictly rising subsequence: the fewest samples are lost."""
    if len(t) < 2 or bool(np.all(np.diff(t) > 0)):
        return np.arange(len(t))
    from bisect import bisect_left

    tails: list[float] = []
    tail_index: list[int] = []
    previous = np.empty(len(t), np.int64)
    for i, value in enumerate(t.tolist()):
        length = bisect_left(tails, value)
        previous[i] = tail_index[length - 1] if length else -1
        if length == len(tails):
            tails.append(value)
            tail_index.append(i)
        else:
            tails[length] = value
            tail_index[length] = i
    chain = [tail_index[-1]]
    while previous[chain[-1]] >= 0:
        chain.append(int(previous[chain[-1]]))
    return np.array(chain[::-1])


def _vectors(x: Array, limit: float, skipped: dict[str, int], absent_is_missing: bool) -> Array:
    """Vectors with zeros where there is none; counts why. An all-NaN sensor or NaN row of the
    magnetometer means "no sample" and is no fault."""
    finite = _whole(np.isfinite(x))
    with np.errstate(invalid="ignore"):
        possible = _whole(np.abs(x) <= limit)
        empty = _whole(x == 0.0)
    nan = _whole(np.isnan(x))
    absent = nan if absent_is_missing or nan.all() else np.zeros(len(x), bool)
    for name, mask in (
        ("nan", ~finite & ~absent),
        ("saturated", finite & ~possible),
        ("zero_vector", finite & empty),
    ):
        if mask.any():
            skipped[name] = skipped.get(name, 0) + int(mask.sum())
    return np.where((finite & possible)[:, None], x, 0.0)


def _mag_use(t: Array, mag: Array, run_number: NDArray[np.int64], hold: bool) -> NDArray[np.int64]:
    """NEW at magnetometer samples, HELD up to 1.5 nominal periods after one of the same run, else MISSING."""
    new = ~_whole(mag == 0.0)
    use = np.where(new, NEW, MISSING)
    at = np.flatnonzero(new)
    if not hold or len(at) < 2:
        return use.astype(np.int64)
    period = float(np.median(np.diff(t[at])))
    last = np.searchsorted(at, np.arange(len(t)), side="right") - 1
    seen = last >= 0
    source = at[np.maximum(last, 0)]
    fresh = seen & (t - t[source] <= HOLD_PERIODS * period) & (run_number == run_number[source])
    return np.where(new, NEW, np.where(fresh, HELD, MISSING)).astype(np.int64)


def _whole_run(estimator: Estimator, s: Samples, values: Mapping[str, float | str], q0: ArrayLike | None) -> Estimate:
    """A whole-run estimator on each run of samples, put together."""
    bounds = np.append(s.begin, len(s.t)).tolist()
    pieces, spent = [], 0.0
    for a, b in pairwise(bounds):
        mag = np.where((s.use[a:b] == NEW)[:, None], s.mag[a:b], np.nan)
        clock = time.perf_counter()
        with plugin_errors(estimator):
            pieces.append(estimator.run(s.t[a:b], s.gyr[a:b], s.acc[a:b], mag, {}, dict(values)))
        spent += time.perf_counter() - clock
    q = np.concatenate([p.q for p in pieces]) if pieces else np.empty((0, 4))
    q = to_true_north(q, values)
    if q0 is not None and len(q) and not s.mag.any():
        want = rotation.error(np.asarray(q0, np.float64), q[0])
        q = rotation.turn_about_down(q, rotation.heading_angle(want))
    has_bias = bool(pieces) and all(p.bias is not None for p in pieces)
    return Estimate(
        t=s.t,
        q=q,
        bias=np.concatenate([p.bias for p in pieces]) if has_bias else None,
        aux={n: np.concatenate([p.aux[n] for p in pieces]) for n in (pieces[0].aux if pieces else {})},
        run=s.run,
        skipped=dict(s.skipped),
        ns_per_update=1e9 * spent / max(len(s.t), 1),
        causal=estimator.causal,
    )


def _quiet(function: Any, estimator: Estimator) -> Any:
    """The plain twin under the compiled kernel's rule: a division by zero gives inf, not a warning."""

    def advance(*arguments: Any) -> None:
        with np.errstate(all="ignore"), plugin_errors(estimator):
            function(*arguments)

    return advance
