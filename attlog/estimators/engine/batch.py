"""One filter with many parameter sets over the same samples, side by side.

Lane i equals a run of its own with the same values (float64: to the last bit or two;
float32: rank a sweep with it, then confirm the winners in float64). Filters whose
step uses arrays otherwise than element by element run one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from attlog.errors import UsageError
from attlog.estimators.base import Estimate, Estimator
from attlog.estimators.engine import cache, expand, generate, loop
from attlog.estimators.engine.samples import Samples, Sampling, prepare
from attlog.estimators.engine.start import initial_state

WIDTH = {"float64": 16, "float32": 32}
"""Lanes that one kernel carries: a few vector registers' worth, more gains nothing."""

LOOP = """
LANES = {lanes}


{functions}


{decorator}def advance(W, dt, substeps, gyr, acc, mag, use, every, out):
    row = 0
    wait = 0
    for k in range(len(dt)):
        h = dt[k] if substeps[k] == 1 else dt[k] / {number}(max(substeps[k], 1))
        g0 = gyr[k, 0]
        g1 = gyr[k, 1]
        g2 = gyr[k, 2]
        a0 = acc[k, 0]
        a1 = acc[k, 1]
        a2 = acc[k, 2]
        if use[k] != 2:
            for i in range(3):
                m = mag[k, i]
                for l in range(LANES):
                    W[({mag} + i) * LANES + l] = m
        for _ in range(substeps[k]):
            if use[k] == 2:
                for l in range(LANES):
                    turn_vector_back(W, l, {mag}, g0{b0}, g1{b1}, g2{b2}, h)
            for l in range(LANES):
                step(W, l, 0, {params}, h, g0, g1, g2, a0, a1, a2, {mag})
        if wait == 0:
            for j in range({outputs}):
                for l in range(LANES):
                    out[row, j, l] = W[j * LANES + l]
            row += 1
            wait = every
        wait -= 1
"""
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
    dtype: Literal["float64", "float32"] = "float64",
) -> list[Estimate]:
    """One estimate for each parameter set of ``params``, in their order; arguments as in :func:`attlog.estimate`.

    UsageError for unknown or impossible values.
    """
    if dtype not in WIDTH:
        raise UsageError(f"dtype={dtype} is not known; give float64 or float32")
    resolved = [{k: v for k, (v, _) in estimator.resolve(preset, p).items()} for p in params]
    samples = prepare(t, gyr, acc, mag, dt=dt, sampling=sampling, hold_mag=estimator.hold_mag)
    results: list[Estimate | None] = [None] * len(resolved)
    for members in _alike(estimator, resolved):
        values = [resolved[i] for i in members]
        for begin in range(0, len(members), WIDTH[dtype]):
            part = values[begin : begin + WIDTH[dtype]]
            for i, one in zip(members[begin:], _run(estimator, part, samples, q0, every, dtype), strict=False):
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
    samples: Samples,
    q0: ArrayLike | None,
    every: int,
    dtype: str,
) -> list[Estimate]:
    """Estimates of up to one kernel width of parameter sets with equal switches."""
    packed = [estimator.pack(v) for v in values]
    switches = {i: float(packed[0][i]) for i, p in enumerate(estimator.own) if p.choices}
    advance = kernel(estimator, switches, dtype) if estimator.step and cache.jit_wanted() else None
    if advance is None:
        return [loop.run(estimator, samples, v, q0, every) for v in values]
    width, count = WIDTH[dtype], len(values)
    cast = {name: np.ascontiguousarray(getattr(samples, name), dtype) for name in ("dt", "gyr", "acc", "mag")}
    bounds = np.append(samples.begin, len(samples.t)).tolist()
    outs, kept = [], []
    for number, (a, b) in enumerate(pairwise(bounds)):
        given = q0 if number == 0 else None
        states = [initial_state(estimator, samples, a, b, p, v, given) for p, v in zip(packed, values, strict=True)]
        work = np.zeros((estimator.state_size + len(packed[0]) + 3, width), dtype)
        for lane in range(width):
            # Lanes beyond the last parameter set repeat it, so that no lane computes with zeros.
            work[: estimator.state_size, lane] = states[min(lane, count - 1)]
            work[estimator.state_size : -3, lane] = packed[min(lane, count - 1)]
        out = np.empty((-(-(b - a) // every), estimator.outputs, width), dtype)
        data = (cast["dt"][a:b], samples.substeps[a:b], cast["gyr"][a:b], cast["acc"][a:b], cast["mag"][a:b])
        advance(work.ravel(), *data, samples.use[a:b], every, out)
        outs.append(out)
        kept.append(np.arange(a, b, every))
    if not outs:
        return [loop.run(estimator, samples, v, q0, every) for v in values]
    out = np.concatenate(outs)
    rows = np.concatenate(kept)
    lanes = np.ascontiguousarray(np.moveaxis(out, 2, 0), np.float64)
    return [loop.collect(estimator, samples, rows, lane, v) for lane, v in zip(lanes, values, strict=False)]


def kernel(estimator: Estimator, switches: Mapping[int, float], dtype: str) -> Any:
    """The compiled loop over samples and lanes; None if the step cannot be rewritten for lanes."""
    from attlog.estimators.engine.vectors import turn_vector_back

    single = dtype == "float32"
    number = "f4" if single else "f8"
    functions = generate.with_helpers(
        {"turn_vector_back": turn_vector_back, "step": estimator.step}, jit=False, single=single
    )
    constants, _, rest = functions.partition("def ")
    rewritten = expand.expand("def " + rest, ENTRY, switches)
    if rewritten is None:
        return None
    bias = estimator.slices.get("bias")
    source = LOOP.format(
        lanes=WIDTH[dtype],
        functions=constants + rewritten.replace("def ", generate.INLINE + "def "),
        decorator=f"@njit({SIGNATURE.format(number)!r}, cache=KEEP, error_model='numpy', no_cfunc_wrapper=True)\n",
        number="np.float32" if single else "np.float64",
        mag=estimator.state_size + len(estimator.own),
        params=estimator.state_size,
        outputs=estimator.outputs,
        **{f"b{i}": "" if bias is None else f" - W[{bias.start + i} * LANES + l]" for i in range(3)},
    )
    return cache.compiled(source, "advance")
