"""The shared loop: runs a filter's step over cleaned samples and keeps its outputs.

Time is its business, not the filter's: :mod:`attlog.estimators.samples` says what happens to
gaps and bad samples; between samples of a slow magnetometer the last vector is propagated
with the bias-corrected gyro; after a long gap the filter starts anew. A step that numba
cannot compile (one that calls a C library, for instance) runs in plain Python.
"""

from __future__ import annotations

import functools
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.core.errors import AttlogError, PluginError
from attlog.core.jit import F1, F2, I1, Loop, aligned_zeros, jit_wanted, plain_python
from attlog.core.jit.loops import with_globals
from attlog.estimators.aids import AidRows, Aids, Measurements, aid_rows
from attlog.estimators.interface import Array, Estimate, Estimator, VectorsAt, broken, plugin_errors
from attlog.estimators.samples import HELD, NEW, PreparedSamples, lagged_samples
from attlog.estimators.start import StartVectors, declination_rad, first, initial_state, realigned, to_true_north
from attlog.estimators.vectors import GRAVITY, turn_vector_back

# A segment whose first field comes after the start: run in two parts, between them the heading is set.

# Runs the samples of a slice with these magnetometer rows and their use, keeping each n-th output in an array.
Part = Callable[[slice, "Array", NDArray[np.int64], int, Any], None]


def late_field(estimator: Estimator, seen: StartVectors, heading_given: bool) -> int | None:
    """Return the sample whose field sets the heading after the start, None where none needs to."""
    return None if heading_given or "mag" not in estimator.uses else seen.late


def in_parts(
    run: Part,
    realign: Callable[[Any], None],
    handed: tuple[Array, NDArray[np.int64]],
    segment: slice,
    late: int | None,
    every: int,
    shape: tuple[int, ...],
    dtype: str = "float64",
) -> Any:
    """Run a segment of samples; return its outputs (rows, *shape), each n-th kept.

    ``handed``: magnetometer rows and their use, for all samples. ``realign`` sets the heading of the
    state from the field of sample ``late`` and writes it to the row of outputs that it gets.
    """
    mag, use = handed
    a, b = segment.start, segment.stop
    if late is None:
        out = np.empty((-(-(b - a) // every), *shape), dtype)
        run(segment, mag[segment], use[segment], every, out)
        return out
    out = np.empty((b - a, *shape), dtype)
    # Up to and with that sample the filter sees no field: it would take it for an error of its heading.
    before, after = slice(a, late + 1), slice(late + 1, b)
    nothing = np.zeros_like(mag[before])
    run(before, nothing, np.zeros_like(use[before]), 1, out[: late + 1 - a])
    realign(out[late - a])
    if late + 1 < b:
        run(after, mag[after], use[after], 1, out[late + 1 - a :])
    return np.ascontiguousarray(out[::every])


def without_heading(
    samples: PreparedSamples, silent: list[tuple[int, int]]
) -> tuple[dict[str, int], list[tuple[float, float]]]:
    """Return ``Estimate.skipped`` and ``Estimate.no_heading`` of the wait for a field.

    ``silent``: of each segment that waited, its first sample and the first with a field.
    """
    spans = [(float(samples.t[a]), float(samples.t[late])) for a, late in silent]
    return ({"late_field": sum(late - a for a, late in silent)} if silent else {}), spans


# Is what a filter's ``run`` returned an Estimate of the samples that it got?
#
# A filter from a file returns what it likes. What is no number, or not one for each time, is reported here, where the
# filter's name is known; further on it would be an exception in whatever computes with it, or silently lose a part.


def check_returned(where: str, one: Any, n: int) -> Estimate:
    """Check what ``run`` returned for ``n`` samples, arrays as float64. PluginError names the file ``where``."""
    if not isinstance(one, Estimate) or np.shape(one.q) != (n, 4):
        raise PluginError(
            f"{where}: run must return an attlog.estimators.Estimate with one attitude for each time, q ({n}, 4)"
        )
    if not isinstance(one.aux, Mapping):
        raise PluginError(f"{where}: aux must be a dictionary of arrays")
    bias = None if one.bias is None else _numbers(where, "bias", one.bias)
    if bias is not None and bias.shape != (n, 3):
        raise PluginError(f"{where}: bias has shape {bias.shape}, not ({n}, 3)")
    aux = {str(name): _numbers(where, f"aux {name!r}", x) for name, x in one.aux.items()}
    for name, x in aux.items():
        if x.ndim not in (1, 2) or len(x) != n:
            raise PluginError(f"{where}: aux {name!r} has shape {x.shape}, not ({n},) or ({n}, k)")
    cost = float(_numbers(where, "ns_per_update", one.ns_per_update).reshape(-1)[:1].sum())
    return replace(
        one,
        q=_numbers(where, "q", one.q),
        bias=bias,
        aux=aux,
        ns_per_update=cost if np.isfinite(cost) and cost > 0 else 0.0,
        skipped=_counts(where, one.skipped),
        quality=_qualities(where, one.quality),
    )


def _numbers(where: str, name: str, values: Any) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise PluginError(f"{where}: {name} holds {array.dtype} in place of real numbers")
    return np.asarray(array, np.float64)


def _counts(where: str, counted: Any) -> dict[str, int]:
    if not isinstance(counted, Mapping) or not all(isinstance(v, int | np.integer) for v in counted.values()):
        raise PluginError(f"{where}: skipped must be a dictionary of whole numbers")
    return {str(name): int(value) for name, value in counted.items()}


def _qualities(where: str, quality: Any) -> dict[str, float | str]:
    if not isinstance(quality, Mapping) or not all(
        isinstance(v, str | float | int | np.floating | np.integer) for v in quality.values()
    ):
        raise PluginError(f"{where}: quality must be a dictionary of numbers and words")
    return {str(name): value if isinstance(value, str) else float(value) for name, value in quality.items()}


T = TypeVar("T")
# Outputs that are one number a sample, (n,), as whole runs return them.
SIGMAS = ("sigma_tilt", "sigma_heading")
# Where the gyro bias begins in the state, -1 for a filter without; a loop gets its filter's number.
BIAS = -1


class Samples(NamedTuple):
    """What a step is handed sample by sample: time and parts of the step, rates, vectors, kind of magnetometer row."""

    dt: F1
    substeps: I1
    gyr: F2
    acc: F2
    mag: F2
    use: I1


def advance(state: F1, params: F1, samples: Samples, aid: AidRows, every: int, out: F2, a: F1, m: F1) -> None:
    """Run the filter over samples and keep each ``every``-th output in ``out`` (rows, outputs).

    ``a``, ``m`` (3,) are scratch: accelerometer and magnetometer vector of a part of a step.
    """
    row = 0
    wait = 0
    for k in range(len(samples.dt)):
        take_sample(state, params, samples, aid, k, a, m)
        if wait == 0:
            for j in range(out.shape[1]):
                out[row, j] = state[j]
            row += 1
            wait = every
        wait -= 1


def take_at_start(state: Any, params: Any, samples: Any, aid: Any, k: int, a: Any, m: Any) -> None:
    """Step with the vectors of the sample before, whose time is that of the state.

    Later parts of a step get no vectors but the field, turned on by the part before.
    """
    parts = samples.substeps[k]
    h = samples.dt[k] if parts == 1 else samples.dt[k] / max(parts, 1)
    for j in range(3):
        a[j] = 0.0
        if samples.use[k] != HELD:
            m[j] = samples.mag[k, j] if samples.use[k] == NEW else 0.0
    for i in range(parts):
        if i > 0 or samples.use[k] == HELD:
            p = k if i > 0 else k - 1
            turn_field(state, m, samples.gyr[p], samples.dt[p] / max(samples.substeps[p], 1))
        call_step(state, params, h, samples.gyr[k], samples.acc[k] if i == 0 else a, m, aid, k, i + 1 == parts)


def take_at_end(state: Any, params: Any, samples: Any, aid: Any, k: int, a: Any, m: Any) -> None:
    """Step with the sample's own vectors; earlier parts of a step, whose time is not theirs, get none."""
    parts = samples.substeps[k]
    h = samples.dt[k] if parts == 1 else samples.dt[k] / max(parts, 1)
    for i in range(parts):
        last = 1.0 if i + 1 == parts else 0.0
        for j in range(3):
            a[j] = last * samples.acc[k, j]
            if samples.use[k] != HELD:
                m[j] = last * samples.mag[k, j]
        if samples.use[k] == HELD:
            turn_field(state, m, samples.gyr[k], h)
        call_step(state, params, h, samples.gyr[k], a, m, aid, k, i + 1 == parts)


def turn_field(state: Any, m: Any, gyr: Any, h: float) -> None:
    """Turn the field (3,) on by the gyro less the filter's bias."""
    x = state[BIAS] if BIAS >= 0 else 0.0
    y = state[BIAS + 1] if BIAS >= 0 else 0.0
    z = state[BIAS + 2] if BIAS >= 0 else 0.0
    turn_vector_back(m, gyr[0] - x, gyr[1] - y, gyr[2] - z, h)


def call_plain(state: Any, params: Any, h: float, gyr: Any, acc: Any, m: Any, aid: Any, k: int, last: bool) -> None:
    """Call a step that takes no aids."""
    step(state, params, h, gyr, acc, m)


def call_aided(state: Any, params: Any, h: float, gyr: Any, acc: Any, m: Any, aid: Any, k: int, last: bool) -> None:
    """Call a step with the aids that arrived, once, in the last part of its sample's step."""
    step(state, params, h, gyr, acc, m, aid.table[aid.row[k] if last else aid.quiet[k]])


# Replaced in each filter's loop by its own.
take_sample, call_step = take_at_start, call_plain


def step(*_: Any) -> None:
    """Stand for a filter's step."""


def loop_of(estimator: Estimator) -> Loop[..., None]:
    """Return the loop around an estimator's step; always the same one for the same step."""
    assert estimator.step is not None
    bias = estimator.slices.get("bias")
    at = -1 if bias is None else int(bias.start)
    return _loop_around(estimator.step, at, estimator.aided, estimator.vectors_at, estimator.name)


@functools.lru_cache(maxsize=64)
def _loop_around(step: Any, bias: int, aided: bool, vectors_at: VectorsAt, name: str) -> Loop[..., None]:
    called = with_globals(call_aided if aided else call_plain, {"step": step})
    turned = with_globals(turn_field, {"BIAS": bias})
    take = take_at_start if vectors_at == "start" else take_at_end
    return Loop(advance, name, {"take_sample": with_globals(take, {"call_step": called, "turn_field": turned})})


def runner(estimator: Estimator) -> Callable[..., None]:
    """Return the loop around a step as a function: machine code, else plain Python that reports a plug-in's line.

    Plain with ATTLOG_NO_JIT=1, and where numba cannot compile a plug-in's step. PluginError where that fails as well.
    """
    return _plain(estimator) if not jit_wanted() or not_compiled(estimator) else loop_of(estimator).compiled()


def _plain(estimator: Estimator) -> Callable[..., None]:
    function = loop_of(estimator).function

    def run(*values: Any) -> None:
        with np.errstate(all="ignore"), plugin_errors(estimator.origin):
            function(*values)

    return run


def not_compiled(estimator: Estimator) -> str:
    """Return why a plug-in's step runs in plain Python, some hundred times slower; empty if it does not.

    PluginError if it fails in Python as well.
    """
    if estimator.process is not None:
        return estimator.process.call(not_compiled)
    if estimator.step is None or not jit_wanted():
        return ""
    reason = _failure(loop_of(estimator))
    if reason and estimator.origin == "attlog":
        raise RuntimeError(f"{estimator.name}: numba cannot compile its step ({reason})")
    if reason:
        _try_two_samples(estimator)
    return reason


@functools.lru_cache(maxsize=64)
def _failure(loop: Loop[..., None]) -> str:
    try:
        loop.compiled()
    except Exception as error:
        return " ".join(str(error).split())[:400]
    return ""


def _try_two_samples(estimator: Estimator) -> None:
    """Run two samples in plain Python, for the line of the plug-in's file that fails."""
    t, vectors = np.array([0.0, 0.01]), np.tile([0.1, 0.2, -GRAVITY], (2, 1))
    samples = Samples(t, np.array([0, 1]), 0.1 * vectors, vectors, vectors, np.array([NEW, NEW]))
    params = estimator.pack({p.name: p.default for p in estimator.parameters})
    values = {p.name: p.default for p in estimator.parameters}
    state = initial_state(estimator, StartVectors(vectors[0], vectors[0], None), params, values, None)
    out = np.empty((2, estimator.outputs))
    _plain(estimator)(state, params, samples, aid_rows(estimator, None, t), 1, out, np.zeros(3), np.zeros(3))


def run(
    estimator: Estimator,
    samples: PreparedSamples,
    values: Mapping[str, float | str],
    q0: ArrayLike | None = None,
    every: int = 1,
    aids: Aids | None = None,
) -> Estimate:
    """Run one filter on prepared samples; ``values`` are all parameters, resolved.

    ``q0`` (4,) body to true north starts the first segment; of every ``every``-th sample the output is kept.
    """
    if estimator.run is not None:
        return _whole_segments(estimator, samples, values, q0, aids or Aids(), every)
    params = estimator.pack(values)
    run_loop = runner(estimator)
    aiding = aid_rows(estimator, aids, samples.t, declination_rad(values))
    scratch = aligned_zeros(3), aligned_zeros(3)
    acc, mag, use = lagged_samples(samples, estimator.vectors_at)
    bounds = np.append(samples.begin, len(samples.t)).tolist()
    chunks: list[Array] = []
    kept, silent, spent = [], [], 0.0
    for number, (a, b) in enumerate(pairwise(bounds)):
        given = q0 if number == 0 else None
        seen = first(samples, a, b, values)
        late = late_field(estimator, seen, given is not None)
        state = initial_state(estimator, seen, params, values, given)

        def run_part(
            part: slice, mag: Array, use: NDArray[np.int64], each: int, out: Array, state: Array = state
        ) -> None:
            nonlocal spent
            own = AidRows(aiding.row[part], aiding.quiet[part], aiding.table)
            data = Samples(samples.dt[part], samples.substeps[part], samples.gyr[part], acc[part], mag, use)
            for vector in scratch:
                vector.fill(0.0)
            clock = time.thread_time()
            run_loop(state, params, data, own, each, out, *scratch)
            spent += time.thread_time() - clock

        def realign(out: Array, state: Array = state, late: int = late or 0) -> None:
            state[:] = realigned(estimator, state, params, samples.mag[late])
            out[:] = state[: estimator.outputs]

        shape = (estimator.outputs,)
        chunks.append(in_parts(run_part, realign, (mag, use), slice(a, b), late, every, shape))
        if every != 1:
            kept.append(np.arange(a, b, every))
        silent += [] if late is None else [(a, late)]
    # Of one segment, the usual case, the kernel's own array: in long logs a copy adds up.
    out = chunks[0] if len(chunks) == 1 else np.concatenate(chunks or [np.empty((0, estimator.outputs))])
    chunks.clear()
    if samples.once:
        del acc, mag, use
        samples.release()
    rows: NDArray[np.int64] | slice = slice(None)
    if every != 1:
        rows = np.concatenate(kept) if kept else np.empty(0, np.int64)
    estimate = collect(estimator, samples, rows, out, values, silent)
    estimate.ns_per_update = 1e9 * spent / max(len(samples.t), 1)
    return estimate


def with_line(estimator: Estimator, run: Callable[[], T]) -> T:
    """Call ``run``; an exception in a plug-in's compiled step becomes a PluginError with file and line.

    Machine code knows no line of the file, so the run is repeated in plain Python; where that raises nothing, the
    exception is reported without.
    """
    try:
        return run()
    except AttlogError:
        raise
    except Exception as error:
        if estimator.origin == "attlog":
            raise
        with plain_python():
            run()
        raise broken(estimator.origin, error) from error


def collect(
    estimator: Estimator,
    samples: PreparedSamples,
    rows: NDArray[np.int64] | slice,
    out: Array,
    values: Mapping[str, float | str],
    silent: list[tuple[int, int]],
) -> Estimate:
    """Make an estimate of kernel output ``out`` (n, outputs) at sample numbers ``rows`` (n,), or all.

    ``silent``: first sample, and first with a field, of each segment that had to wait for it. What the filter gave
    beside attitude and bias are views of ``out``: who drops them releases it.
    """
    aux = {name: out[:, part.start if name in SIGMAS else part] for name, part in estimator.slices.items()}
    bias = aux.pop("bias", None)
    counted, spans = without_heading(samples, silent)
    return Estimate(
        t=samples.t[rows],
        q=np.ascontiguousarray(to_true_north(out[:, :4], values)),
        bias=None if bias is None else bias.copy(),
        aux=aux,
        segment=samples.segment[rows],
        skipped=samples.skipped | counted,
        causal=estimator.causal,
        quality=truncation_note(samples),
        no_heading=spans,
    )


def truncation_note(samples: PreparedSamples) -> dict[str, float | str]:
    """Return a gyro's steps in deg/s and the time from which half of one is added, where readings are cut."""
    cut = samples.truncation
    if cut is None:
        return {}
    last = min(cut.readings, len(samples.t) - 1)
    return {"gyro_step_dps": float(np.degrees(cut.step.max())), "gyro_step_added_from_s": float(samples.t[last])}


def end_to_end(parts: list[Array]) -> Array:
    """Join arrays (n, ...) along the first axis; a single one, the usual case, is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def joined_aux(found: list[Estimate]) -> dict[str, Array]:
    """Join the auxiliary outputs of segments; NaN where a segment lacks one of another."""
    shapes = {name: x.shape[1:] for e in reversed(found) for name, x in e.aux.items()}
    first = found[0].aux if found else {}
    names = dict.fromkeys([*first, *shapes])
    return {n: end_to_end([e.aux.get(n, np.full((len(e.q), *shapes[n]), np.nan)) for e in found]) for n in names}


def _whole_segments(
    estimator: Estimator,
    s: PreparedSamples,
    values: Mapping[str, float | str],
    q0: ArrayLike | None,
    aids: Aids,
    every: int,
) -> Estimate:
    """Run a whole-run estimator on each segment of samples; its own count of ns per update wins.

    What it says of itself is that of the longest segment.
    """
    assert estimator.run is not None
    bounds = np.append(s.begin, len(s.t)).tolist()
    found: list[Estimate] = []
    silent: list[tuple[int, int]] = []
    spent, has_field = 0.0, bool(q0 is not None and s.mag.any())
    for number, (a, b) in enumerate(pairwise(bounds)):
        # One that looks ahead knows the heading before the first field as well.
        known = not estimator.causal or (q0 is not None and number == 0)
        late = late_field(estimator, first(s, a, b, values), known)
        silent += [] if late is None else [(a, late)]
        clock = time.thread_time()
        with plugin_errors(estimator.origin):
            own = [x[a:b] for x in (s.t, s.gyr, s.acc)]
            own.append(np.where((s.use[a:b] == NEW)[:, None], s.mag[a:b], np.nan))
            if estimator.origin != "attlog":  # it may write to its inputs; the times go with its result
                own = [x.copy() for x in own]
            begin, gyr, acc, mag = own
            own_aids = aids.between(s.t[a], s.t[b - 1])
            if estimator.origin != "attlog" and own_aids.mag is None:
                own_aids = replace(own_aids, mag=_own_samples(s.t[a:b], mag))
            one = estimator.run(begin, gyr, acc, mag, own_aids, dict(values))
            if estimator.origin != "attlog":
                one = check_returned(estimator.origin, one, b - a)
        spent += 1e-9 * one.ns_per_update * (b - a) or time.thread_time() - clock
        found.append(one)
    q = to_true_north(end_to_end([e.q for e in found]) if found else np.empty((0, 4)), values)
    if q0 is not None and len(q) and not has_field:
        want = rotation.earth_error(np.asarray(q0, np.float64), q[0])
        q = rotation.turn_about_down(q, rotation.heading_angle(want))
    counted, spans = without_heading(s, silent)
    skipped = Counter(s.skipped | counted)
    for one in found:
        skipped.update(one.skipped)
    biases = [e.bias for e in found if e.bias is not None]
    rows: NDArray[np.int64] | slice = slice(None)
    if every != 1:
        rows = np.concatenate([np.empty(0, np.int64), *(np.arange(a, b, every) for a, b in pairwise(bounds))])
    return Estimate(
        t=s.t[rows],
        q=q[rows],
        bias=end_to_end(biases)[rows] if biases and len(biases) == len(found) else None,
        aux={name: x[rows] for name, x in joined_aux(found).items()},
        segment=s.segment[rows],
        skipped=dict(skipped),
        ns_per_update=1e9 * spent / max(len(s.t), 1),
        causal=estimator.causal and all(one.causal for one in found),
        quality=(max(found, key=lambda e: len(e.q)).quality if found else {}) | truncation_note(s),
        no_heading=spans,
    )


def _own_samples(t: Array, mag: Array) -> Measurements | None:
    """Return the new samples of a magnetometer on the IMU's times (n,), NaN rows between; None without any."""
    new = np.isfinite(mag).all(axis=1)
    return Measurements(t[new], mag[new]) if new.any() else None
