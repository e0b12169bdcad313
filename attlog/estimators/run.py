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
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.core.errors import AttlogError, PluginError
from attlog.core.jit import call
from attlog.core.jit import kernel as generate
from attlog.core.jit.compile import by_numba, obtained
from attlog.core.jit.kernel import Kernel
from attlog.estimators.aids import Aids, Measurements, events
from attlog.estimators.interface import KERNEL_SOURCES, Array, Estimate, Estimator, broken, plugin_errors
from attlog.estimators.samples import NEW, PreparedSamples, lagged_samples
from attlog.estimators.start import StartVectors, declination_rad, first, initial_state, realigned, to_true_north
from attlog.estimators.vectors import GRAVITY, turn_vector_back

# A segment whose first field comes after the start: run in two parts, between them the heading is set.

Part = Callable[[slice, "Array", NDArray[np.int64], int, Any], None]
"""Runs the samples of a slice with these magnetometer rows and their use, keeping each n-th output in an array."""


def late_field(estimator: Estimator, seen: StartVectors, heading_given: bool) -> int | None:
    """The sample whose field sets the heading of this filter after the start; None where none needs to."""
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
    """Outputs (rows, *shape) of a segment of samples, each n-th kept.

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
    """What the wait for a field is worth in ``Estimate.skipped`` and ``Estimate.no_heading``.

    ``silent``: of each segment that waited, its first sample and the first with a field.
    """
    spans = [(float(samples.t[a]), float(samples.t[late])) for a, late in silent]
    return ({"late_field": sum(late - a for a, late in silent)} if silent else {}), spans


# Is what a filter's ``run`` returned an Estimate of the samples that it got?
#
# A filter from a file returns what it likes. What is no number, or not one for each time, is reported here, where the
# filter's name is known; further on it would be an exception in whatever computes with it, or silently lose a part.


def returned(where: str, one: Any, n: int) -> Estimate:
    """``one`` with arrays of float64, for ``n`` samples. PluginError names the file ``where``."""
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
LOOP = """
def advance(state, params, dt, substeps, gyr, acc, mag, use, every, out{events}, a, m):
    row = 0
    wait = 0
    for k in range(len(dt)):
        h = dt[k] if substeps[k] == 1 else dt[k] / max(substeps[k], 1)
{parts}
        if wait == 0:
            for j in range({outputs}):
                out[row, j] = state[j]
            row += 1
            wait = every
        wait -= 1
"""
AT_START = """
        if use[k] == 1:
            m[0] = mag[k, 0]
            m[1] = mag[k, 1]
            m[2] = mag[k, 2]
        elif use[k] == 0:
            m[0] = 0.0
            m[1] = 0.0
            m[2] = 0.0
        for i in range(substeps[k]):
            if i > 0 or use[k] == 2:
                p = k if i > 0 else k - 1
                turn_vector_back(m, gyr[p, 0]{bx}, gyr[p, 1]{by}, gyr[p, 2]{bz}, dt[p] / max(substeps[p], 1))
            step(state, params, h, gyr[k], acc[k] if i == 0 else a, m{aid})
"""
"""Vectors are those of the sample before, whose time is that of the state; in later parts of a step none but the field.

The last field is turned on by the part of a step that was taken last.
"""
AT_END = """
        for i in range(substeps[k]):
            last = 1.0 if i + 1 == substeps[k] else 0.0
            for j in range(3):
                a[j] = last * acc[k, j]
                if use[k] != 2:
                    m[j] = last * mag[k, j]
            if use[k] == 2:
                turn_vector_back(m, gyr[k, 0]{bx}, gyr[k, 1]{by}, gyr[k, 2]{bz}, h)
            step(state, params, h, gyr[k], a, m{aid})
"""
"""Vectors are the sample's own; in the earlier parts of a step, whose time is not theirs, there are none."""
PLAIN = {"events": "", "aid": ""}
AIDED = {"events": ", row_of, quiet, table", "aid": ", table[row_of[k] if i == substeps[k] - 1 else quiet[k]]"}
"""What a loop with aids has more: an arrival is handed on once, in the last part of its sample's step."""

SIGMAS = ("sigma_tilt", "sigma_heading")
"""Outputs that are one number a sample, (n,), as whole runs give them."""

SIGNATURE = (
    "void(f8[::1], f8[::1], f8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1], i8, f8[:, ::1]{events})"
)
EVENTS = ", i8[::1], i8[::1], f8[:, ::1]"
SCRATCH = (("f8", (3,)), ("f8", (3,)))
"""Accelerometer and magnetometer vectors of a part of a step."""


def run(
    estimator: Estimator,
    samples: PreparedSamples,
    values: Mapping[str, float | str],
    q0: ArrayLike | None = None,
    every: int = 1,
    aids: Aids | None = None,
) -> Estimate:
    """The estimate of one filter on prepared samples; ``values`` are all parameters, resolved.

    ``q0`` (4,) body to true north starts the first segment; of every ``every``-th sample the output is kept.
    """
    if estimator.run is not None:
        return _whole_segments(estimator, samples, values, q0, aids or Aids())
    params = estimator.pack(values)
    advance = loop_of(estimator)
    aiding = events(estimator, aids, samples.t, declination_rad(values)) if estimator.aided else None
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
            extra = () if aiding is None else (aiding.row[part], aiding.quiet[part], aiding.table)
            data = (samples.dt[part], samples.substeps[part], samples.gyr[part], acc[part], mag, use)
            clock = time.thread_time()
            advance(state, params, *data, each, out, *extra)
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
    """What ``run`` gives. An exception in a plug-in's compiled step becomes a PluginError with file and line.

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
        with call.plainly():
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
    """The estimate that kernel output ``out`` (n, outputs) at sample numbers ``rows`` (n,), or all, means.

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
        no_heading=spans,
    )


def loop_of(estimator: Estimator) -> Any:
    """The loop around the estimator's step: compiled, or plain Python with ATTLOG_NO_JIT=1 or where it cannot be.

    PluginError if a plug-in's step fails in Python as well.
    """
    if not call.jit_wanted():
        return _twin(estimator)
    return _kernel(estimator)[0]


def not_compiled(estimator: Estimator) -> str:
    """Why the step of a plug-in runs in plain Python, which costs it a factor of about a hundred; "" if it does not.

    PluginError as in :func:`kernel`.
    """
    if estimator.process is not None:
        return estimator.process.call(not_compiled)
    if estimator.step is None or not call.jit_wanted():
        return ""
    return _kernel(estimator)[1]


def kernel_of_step(estimator: Estimator) -> Kernel:
    """The loop around a step, for a compiler."""
    assert estimator.step is not None
    shape = (_bias_at(estimator), estimator.outputs, estimator.aided, estimator.vectors_at == "start")
    return _kernel_of(estimator.step, *shape, estimator.name, estimator.origin == "attlog")


def _kernel_of(
    step: Callable[..., Any], bias: int | None, outputs: int, aided: bool, at_start: bool, what: str, ours: bool
) -> Kernel:
    def text() -> str:
        helpers = generate.with_helpers({"turn_vector_back": turn_vector_back, "step": step}, jit=True)
        return f"{helpers}\n\n{_loop(bias, outputs, aided, at_start)}"

    name = f"loop {step.__module__} {bias} {outputs} {aided} {at_start}"
    signature = SIGNATURE.format(events=EVENTS if aided else "")
    return Kernel(name, "advance", text, signature, what, KERNEL_SOURCES if ours else (), SCRATCH)


@functools.lru_cache(maxsize=64)
def _loaded(
    step: Callable[..., Any], bias: int | None, outputs: int, aided: bool, at_start: bool, what: str, ours: bool
) -> tuple[Any, str]:
    """The compiled kernel and "", or None and why there is none.

    A plug-in that is loaded again is another function, so its kernel is made anew.
    """
    kernel = _kernel_of(step, bias, outputs, aided, at_start, what, ours)
    try:
        return (obtained if ours else by_numba)(kernel), ""
    except Exception as error:
        return None, " ".join(str(error).split())[:400]


def _kernel(estimator: Estimator) -> tuple[Any, str]:
    """The kernel of an estimator, and why it is not a compiled one ("" if it is)."""
    assert estimator.step is not None
    shape = (_bias_at(estimator), estimator.outputs, estimator.aided, estimator.vectors_at == "start")
    compiled, reason = _loaded(estimator.step, *shape, estimator.name, estimator.origin == "attlog")
    if compiled is not None:
        return compiled, ""
    if estimator.origin == "attlog":
        raise RuntimeError(f"{estimator.name}: numba cannot compile its step ({reason})")
    _try_plainly(estimator)
    return _twin(estimator), reason


def _loop(bias: int | None, outputs: int, aided: bool, at_start: bool) -> str:
    """The loop's text; ``bias`` is where the gyro bias stands in the state."""
    b = ["" if bias is None else f" - state[{bias + i}]" for i in range(3)]
    more = AIDED if aided else PLAIN
    parts = (AT_START if at_start else AT_END).format(bx=b[0], by=b[1], bz=b[2], aid=more["aid"]).strip("\n")
    return LOOP.format(parts=parts, outputs=outputs, events=more["events"]).lstrip()


def _bias_at(estimator: Estimator) -> int | None:
    bias = estimator.slices.get("bias")
    return None if bias is None else bias.start


def _twin(estimator: Estimator) -> Any:
    """The plain twin under the compiled kernel's rule: a division by zero gives inf, not a warning."""
    used = {"turn_vector_back": turn_vector_back, "step": estimator.step}
    source = _loop(_bias_at(estimator), estimator.outputs, estimator.aided, estimator.vectors_at == "start")
    function = call.plain(source, "advance", used)

    def advance(*arguments: Any) -> None:
        with np.errstate(all="ignore"), plugin_errors(estimator.origin):
            function(*arguments, *(np.zeros(shape, kind) for kind, shape in SCRATCH))

    return advance


def _try_plainly(estimator: Estimator) -> None:
    """Run two samples in plain Python: what is wrong there has a line in the plug-in's file. PluginError says it."""
    vectors = np.tile([0.1, 0.2, -GRAVITY], (2, 1))
    still = PreparedSamples(
        np.array([0.0, 0.01]),
        np.array([0.0, 0.01]),
        np.array([0, 1]),
        0.1 * vectors,
        vectors,
        vectors,
        np.array([NEW, NEW]),
        np.zeros(2, np.int64),
        np.zeros(1, np.int64),
    )
    values = {p.name: p.default for p in estimator.parameters}
    params = estimator.pack(values)
    state = initial_state(estimator, StartVectors(vectors[0], vectors[0], None), params, values, None)
    out = np.empty((2, estimator.outputs))
    aiding = events(estimator, None, still.t)
    extra = (aiding.row, aiding.quiet, aiding.table) if estimator.aided else ()
    data = (still.dt, still.substeps, still.gyr, still.acc, still.mag, still.use, 1, out)
    _twin(estimator)(state, params, *data, *extra)


def end_to_end(parts: list[Array]) -> Array:
    """Arrays (n, ...) joined along the first axis; of one, the usual case, itself: in long logs a copy adds up."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def joined_aux(found: list[Estimate]) -> dict[str, Array]:
    """What segments tell beside attitude and bias, end to end; NaN where one does not tell what another does."""
    shapes = {name: x.shape[1:] for e in reversed(found) for name, x in e.aux.items()}
    first = found[0].aux if found else {}
    names = dict.fromkeys([*first, *shapes])
    return {n: end_to_end([e.aux.get(n, np.full((len(e.q), *shapes[n]), np.nan)) for e in found]) for n in names}


def _whole_segments(
    estimator: Estimator, s: PreparedSamples, values: Mapping[str, float | str], q0: ArrayLike | None, aids: Aids
) -> Estimate:
    """A whole-run estimator on each segment of samples, put together; its own count of ns per update wins.

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
            told = aids.between(s.t[a], s.t[b - 1])
            if estimator.origin != "attlog" and told.mag is None:
                told = replace(told, mag=_own_samples(s.t[a:b], mag))
            one = estimator.run(begin, gyr, acc, mag, told, dict(values))
            if estimator.origin != "attlog":
                one = returned(estimator.origin, one, b - a)
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
    return Estimate(
        t=s.t,
        q=q,
        bias=end_to_end(biases) if biases and len(biases) == len(found) else None,
        aux=joined_aux(found),
        segment=s.segment,
        skipped=dict(skipped),
        ns_per_update=1e9 * spent / max(len(s.t), 1),
        causal=estimator.causal and all(one.causal for one in found),
        quality=max(found, key=lambda e: len(e.q)).quality if found else {},
        no_heading=spans,
    )


def _own_samples(t: Array, mag: Array) -> Measurements | None:
    """The new samples of a magnetometer on the IMU's times (n,), NaN rows between; None if there is none."""
    new = np.isfinite(mag).all(axis=1)
    return Measurements(t[new], mag[new]) if new.any() else None
