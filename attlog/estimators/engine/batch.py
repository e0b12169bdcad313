"""One filter with many parameter sets over the same samples, side by side.

Set i gives what a run of its own with the same values gives (float64: to the last bit or two;
float32: rank a sweep with it, then confirm the winners in float64). One after the other, in
float64, run filters whose step uses arrays otherwise than element by element, takes aids or
cannot be compiled, whole-run estimators, and what is too little work for a kernel of its own:
it is compiled for each filter with the values of its switches, which takes seconds.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from attlog.base.errors import UsageError
from attlog.estimators.aids import Aids
from attlog.estimators.base import Array, Estimate, Estimator, LogFacts
from attlog.estimators.engine import SOURCES, expand, loop
from attlog.estimators.engine.late import in_parts, late_field
from attlog.estimators.engine.samples import PreparedSamples, Sampling, handed, prepare
from attlog.estimators.engine.start import first, initial_state, realigned
from attlog.kernels import cache, generate
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import at_hand, by_numba, obtained

WIDTH = {"float64": 16, "float32": 32}
"""Parameter sets that one kernel carries: a few vector registers' worth, more gains nothing."""
WORTH = 5_000_000
"""Updates (sets times samples) from which on sets run side by side: one by one so many take a quarter of a second."""

LOOP = """
SETS_ = {sets}


{functions}


def advance(BATCH_, dt, substeps, gyr, acc, mag, use, every, out):
    row = 0
    wait = 0
    for k in range(len(dt)):
        h = dt[k] if substeps[k] == 1 else dt[k] / {number}(max(substeps[k], 1))
        g0 = gyr[k, 0]
        g1 = gyr[k, 1]
        g2 = gyr[k, 2]
{parts}
        if wait == 0:
            for j in range({outputs}):
                for set_ in range(SETS_):
                    out[row, j, set_] = BATCH_[j * SETS_ + set_]
            row += 1
            wait = every
        wait -= 1
"""
AT_START = """
        a0 = acc[k, 0]
        a1 = acc[k, 1]
        a2 = acc[k, 2]
        if use[k] != 2:
            for i in range(3):
                m = mag[k, i]
                for set_ in range(SETS_):
                    BATCH_[({mag} + i) * SETS_ + set_] = m
        for i in range(substeps[k]):
            if i > 0 or use[k] == 2:
                p = k if i > 0 else k - 1
                f = dt[p] / {number}(max(substeps[p], 1))
                for set_ in range(SETS_):
                    turn_vector_back(BATCH_, set_, {mag}, gyr[p, 0]{b0}, gyr[p, 1]{b1}, gyr[p, 2]{b2}, f)
            if i > 0:
                a0 = {number}(0.0)
                a1 = {number}(0.0)
                a2 = {number}(0.0)
            for set_ in range(SETS_):
                step(BATCH_, set_, 0, {params}, h, g0, g1, g2, a0, a1, a2, {mag})
"""
AT_END = """
        for i in range(substeps[k]):
            last = {number}(1.0) if i + 1 == substeps[k] else {number}(0.0)
            a0 = last * acc[k, 0]
            a1 = last * acc[k, 1]
            a2 = last * acc[k, 2]
            for j in range(3):
                m = last * mag[k, j]
                for set_ in range(SETS_ if use[k] != 2 else 0):
                    BATCH_[({mag} + j) * SETS_ + set_] = m
            if use[k] == 2:
                for set_ in range(SETS_):
                    turn_vector_back(BATCH_, set_, {mag}, g0{b0}, g1{b1}, g2{b2}, h)
            for set_ in range(SETS_):
                step(BATCH_, set_, 0, {params}, h, g0, g1, g2, a0, a1, a2, {mag})
"""
"""As the loop of a single filter does it."""
SIGNATURE = "void({0}[::1], {0}[::1], i8[::1], {0}[:, ::1], {0}[:, ::1], {0}[:, ::1], i8[::1], i8, {0}[:, :, ::1])"
ENTRY = {
    "turn_vector_back": {0: expand.ROW},
    "step": {0: expand.ROW, 1: expand.ROW, 3: expand.SHARED, 4: expand.SHARED, 5: expand.ROW},
}


def estimate_batch(
    estimator: Estimator,
    params: Sequence[Mapping[str, float | str]],
    t: ArrayLike,
    gyr: ArrayLike,
    acc: ArrayLike | None = None,
    mag: ArrayLike | None = None,
    *,
    preset: str | None = None,
    sampling: Sampling = "interval",
    q0: ArrayLike | None = None,
    dt: ArrayLike | None = None,
    every: int = 1,
    aids: Aids | None = None,
    log: LogFacts | None = None,
    dtype: Literal["float64", "float32"] = "float64",
) -> list[Estimate]:
    """One estimate for each parameter set of ``params``, in their order; arguments as in :func:`attlog.estimate`.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) any unit, body axes; ``dt`` (n,) s.
    UsageError for unknown or impossible values.
    """
    if dtype not in WIDTH:
        raise UsageError(f"dtype={dtype} is not known; give float64 or float32")
    if estimator.process is not None:
        facts = None if log is None else replace(log, params=dict(log.params), given=dict(log.given))
        return estimator.process.call(
            estimate_batch,
            [dict(p) for p in params],
            t,
            gyr,
            acc,
            mag,
            preset=preset,
            sampling=sampling,
            q0=q0,
            dt=dt,
            every=every,
            aids=aids,
            log=facts,
            dtype=dtype,
        )
    resolved = [{k: v for k, (v, _) in estimator.resolve(preset, p, log=log).items()} for p in params]
    samples = prepare(t, gyr, acc, mag, dt=dt, sampling=sampling, hold_mag=estimator.hold_mag)
    results: list[Estimate | None] = [None] * len(resolved)
    for members in _alike(estimator, resolved):
        beside = dtype == "float32" or len(members) * len(samples.t) >= WORTH
        for begin in range(0, len(members), WIDTH[dtype]):
            some = [resolved[i] for i in members[begin : begin + WIDTH[dtype]]]
            found = loop.with_line(
                estimator,
                lambda some=some, beside=beside: _run(estimator, some, samples, q0, every, aids, dtype, beside),  # type: ignore[misc]
            )
            for i, one in zip(members[begin:], found, strict=False):
                results[i] = one
    return [r for r in results if r is not None]


def _alike(estimator: Estimator, resolved: list[dict[str, float | str]]) -> list[list[int]]:
    """Positions grouped by the values of the switches, which are constants of a kernel."""
    groups: dict[tuple[str, ...], list[int]] = {}
    for i, values in enumerate(resolved):
        groups.setdefault(tuple(str(values[p.name]) for p in estimator.own if p.choices), []).append(i)
    return list(groups.values())


def _run(
    estimator: Estimator,
    values: list[dict[str, float | str]],
    samples: PreparedSamples,
    q0: ArrayLike | None,
    every: int,
    aids: Aids | None,
    dtype: str,
    beside: bool,
) -> list[Estimate]:
    """Estimates of up to one kernel width of parameter sets with equal switches, ``beside`` each other or in turn."""
    packed = [estimator.pack(v) for v in values]
    switches = {i: float(packed[0][i]) for i, p in enumerate(estimator.own) if p.choices}
    wanted = beside and cache.jit_wanted() and len(samples.t)
    advance = kernel(estimator, switches, dtype) if wanted else None
    if advance is None:
        return [loop.run(estimator, samples, v, q0, every, aids) for v in values]
    width, count = WIDTH[dtype], len(values)
    cast = {name: np.ascontiguousarray(getattr(samples, name), dtype) for name in ("dt", "gyr")}
    acc, mag, use = handed(samples, estimator.vectors_at)
    acc, mag = acc.astype(dtype, copy=False), mag.astype(dtype, copy=False)
    bounds = np.append(samples.begin, len(samples.t)).tolist()
    outs, kept, silent = [], [], []
    size = estimator.state_size
    for number, (a, b) in enumerate(pairwise(bounds)):
        given = q0 if number == 0 else None
        shown = {init: first(samples, a, b, {"init": init}) for init in {str(v.get("init", "average")) for v in values}}
        seen = [shown[str(v.get("init", "average"))] for v in values]
        late = late_field(estimator, seen[0], given is not None)
        work = np.zeros((size + len(packed[0]) + 3, width), dtype)
        for column in range(width):
            # Columns beyond the last parameter set repeat it, so that none computes with zeros.
            i = min(column, count - 1)
            if column < count:
                state = initial_state(estimator, seen[i], packed[i], values[i], given)
            work[:size, column] = state
            work[size:-3, column] = packed[i]

        def run_part(part: slice, mag: Array, use: Any, each: int, out: Any, work: Any = work) -> None:
            data = (cast["dt"][part], samples.substeps[part], cast["gyr"][part], acc[part], mag, use)
            advance(work.ravel(), *data, each, out)

        def realign(out: Any, work: Any = work, late: int = late or 0) -> None:
            for column in range(width):
                state = work[:size, column].astype(np.float64)
                work[:size, column] = realigned(estimator, state, packed[min(column, count - 1)], samples.mag[late])
            out[:] = work[: estimator.outputs]

        shape = (estimator.outputs, width)
        outs.append(in_parts(run_part, realign, (mag, use), slice(a, b), late, every, shape, dtype))
        kept.append(np.arange(a, b, every))
        silent += [] if late is None else [(a, late)]
    out = np.concatenate(outs)
    rows = np.concatenate(kept)
    by_set = np.ascontiguousarray(np.moveaxis(out, 2, 0), np.float64)
    return [loop.collect(estimator, samples, rows, one, v, silent) for one, v in zip(by_set, values, strict=False)]


def kernel(estimator: Estimator, switches: Mapping[int, float], dtype: str) -> Any:
    """The compiled loop over samples and sets; None if there is no step or it cannot be rewritten for several sets."""
    if estimator.step is None or estimator.aided or loop.not_compiled(estimator):
        return None
    bias = estimator.slices.get("bias")
    shape = (
        estimator.step,
        tuple(sorted(switches.items())),
        dtype,
        (estimator.state_size, len(estimator.own), estimator.outputs, None if bias is None else int(bias.start)),
        estimator.vectors_at,
    )
    return _loaded(*shape, f"{estimator.name} for many parameter sets", estimator.origin == "attlog")


@functools.lru_cache(maxsize=64)
def _loaded(
    step: Callable[..., Any],
    switches: tuple[tuple[int, float], ...],
    dtype: str,
    sizes: tuple[int, int, int, int | None],
    vectors_at: str,
    what: str,
    ours: bool,
) -> Any:
    """The compiled kernel; a sweep asks for the same one for every 16 sets."""

    def text() -> str:
        return _source(step, switches, dtype, sizes, vectors_at) or ""

    # Whether a plug-in's step can be rewritten shows only in the text, and one of ours is not asked twice.
    if not ours and not text():
        return None
    name = f"batch {step.__module__} {switches} {dtype} {sizes} {vectors_at}"
    kernel = Kernel(
        name, "advance", text, SIGNATURE.format("f4" if dtype == "float32" else "f8"), what, SOURCES if ours else ()
    )
    if ours:
        return at_hand(kernel) or (obtained(kernel) if text() else None)
    return by_numba(kernel)


@functools.lru_cache(maxsize=64)
def _source(
    step: Callable[..., Any],
    switches: tuple[tuple[int, float], ...],
    dtype: str,
    sizes: tuple[int, int, int, int | None],
    vectors_at: str,
) -> str | None:
    """The kernel's text, None where the step cannot be rewritten; a sweep asks for the same one for every 16 sets.

    ``sizes``: of the state, of the parameters, how many outputs, where the gyro bias stands.
    """
    from attlog.estimators.engine.vectors import turn_vector_back

    single = dtype == "float32"
    functions = generate.with_helpers({"turn_vector_back": turn_vector_back, "step": step}, jit=False, single=single)
    constants, _, rest = functions.partition("def ")
    rewritten = expand.expand("def " + rest, ENTRY, dict(switches))
    if rewritten is None:
        return None
    state_size, own, outputs, bias = sizes
    places = {
        "mag": state_size + own,
        "params": state_size,
        "number": "np.float32" if single else "np.float64",
        **{f"b{i}": "" if bias is None else f" - BATCH_[{bias + i} * SETS_ + set_]" for i in range(3)},
    }
    return LOOP.format(
        sets=WIDTH[dtype],
        functions=constants + rewritten.replace("def ", generate.INLINE + "def "),
        number=places["number"],
        parts=(AT_START if vectors_at == "start" else AT_END).format(**places).strip("\n"),
        outputs=outputs,
    )
