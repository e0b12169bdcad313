"""One filter with many parameter sets over the same samples, side by side.

Set i gives what a run of its own with the same values gives (float64: to the last bit or two;
float32: rank a sweep with it, then confirm the winners in float64). One after the other, in
float64, run filters whose step uses arrays otherwise than element by element, takes aids or
cannot be compiled, whole-run estimators, and what is too little work for a kernel of its own:
it is compiled for each filter with the values of its switches, which takes seconds.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from attlog.core.errors import UsageError
from attlog.core.jit import call
from attlog.core.jit import kernel as generate
from attlog.core.jit.compile import at_hand, by_numba, obtained
from attlog.core.jit.kernel import Kernel
from attlog.estimators import run
from attlog.estimators.aids import Aids
from attlog.estimators.interface import KERNEL_SOURCES, Array, Estimate, Estimator, LogFacts
from attlog.estimators.run import in_parts, late_field
from attlog.estimators.samples import PreparedSamples, Sampling, lagged_samples, prepare
from attlog.estimators.start import first, initial_state, realigned

# A filter's functions rewritten for many parameter sets: the same arithmetic, side by side in one array.
#
# Two kinds of array arguments disappear. One that differs between the sets (``state``,
# ``params``, ``mag``) becomes a row number of one array ``BATCH_`` of ``SETS_`` columns:
# ``state[i]`` turns into ``BATCH_[(state + i) * SETS_ + set_]``, so that the loop over sets reads
# and writes neighbours, which is what the compiler needs for vector registers. One that
# all sets share (``gyr``, ``acc``) becomes three numbers, ``acc[0]`` turns into ``acc_0``.

BATCH, SETS, SET = "BATCH_", "SETS_", "set_"
LEADING = (BATCH, SET)
ROW, SHARED = "row", "shared"

Kinds = dict[str, dict[str, str]]


def expand(source: str, entry: Mapping[str, Mapping[int, str]], fixed: Mapping[int, float]) -> str | None:
    """The source with its functions rewritten, or None if an array is used other than element by element.

    None also for source that has one of our own names already.

    ``entry`` names the functions that the loop calls and the kinds of their array arguments
    by position; those of helpers follow from the calls. ``fixed`` gives the elements of the
    array ``params`` that are the same in all sets: they become constants.
    """
    module = ast.parse(source)
    taken = _names(module)
    if taken & {BATCH, SETS, SET}:
        return None
    functions = {f.name: f for f in module.body if isinstance(f, ast.FunctionDef)}
    kinds: Kinds = {n: {functions[n].args.args[i].arg: k for i, k in a.items()} for n, a in entry.items()}
    if not _spread(functions, kinds):
        return None
    if not all(_elementwise(f, kinds.get(n, {}), functions) for n, f in functions.items()):
        return None
    if taken & {n for own in kinds.values() for a, kind in own.items() if kind == SHARED for n in _spelled(a, own)}:
        return None
    for name, function in functions.items():
        own = kinds.get(name, {})
        _Rewrite(own, kinds, functions, fixed if name == "step" else {}).visit(function)
    for name, function in functions.items():
        function.args.args = [ast.arg(a) for a in LEADING] + [
            ast.arg(n) for a in function.args.args for n in _spelled(a.arg, kinds.get(name, {}))
        ]
    return ast.unparse(ast.fix_missing_locations(module))


def _names(module: ast.Module) -> set[str]:
    """Every name in a source: of variables, arguments and functions."""
    nodes = list(ast.walk(module))
    found = {n.id for n in nodes if isinstance(n, ast.Name)} | {n.arg for n in nodes if isinstance(n, ast.arg)}
    return found | {n.name for n in nodes if isinstance(n, ast.FunctionDef)}


def _spelled(name: str, kinds: Mapping[str, str]) -> list[str]:
    """The names that stand for an argument after rewriting."""
    return [f"{name}_{i}" for i in range(3)] if kinds.get(name) == SHARED else [name]


def _spread(functions: Mapping[str, ast.FunctionDef], kinds: Kinds) -> bool:
    """Find the kinds of helpers' arguments from the calls that hand arrays on; False where two calls disagree."""
    waiting = list(kinds)
    while waiting:
        name = waiting.pop()
        for call in _calls(functions[name], functions):
            callee = functions[_called(call)]
            known = kinds.setdefault(callee.name, {})
            for argument, given in zip(callee.args.args, call.args, strict=False):
                kind = kinds[name].get(given.id) if isinstance(given, ast.Name) else None
                if known.get(argument.arg, kind) != kind:
                    return False
                if kind and argument.arg not in known:
                    known[argument.arg] = kind
                    waiting.append(callee.name)
    return True


def _calls(function: ast.FunctionDef, functions: Mapping[str, ast.FunctionDef]) -> list[ast.Call]:
    """Calls inside a function to functions of the same source."""
    return [n for n in ast.walk(function) if isinstance(n, ast.Call) and _called(n) in functions]


def _called(call: ast.Call) -> str:
    """The name of the function that is called; "" if it is not called by name."""
    return call.func.id if isinstance(call.func, ast.Name) else ""


def _elementwise(function: ast.FunctionDef, kinds: Mapping[str, str], functions: Mapping[str, ast.FunctionDef]) -> bool:
    """True if arrays are only indexed by numbers or handed to functions of the same source by position."""
    nodes = list(ast.walk(function))
    uses = sum(isinstance(n, ast.Name) and n.id in kinds for n in nodes)
    indexed = sum(isinstance(n, ast.Subscript) and _element_of(n, kinds) is not None for n in nodes)
    handed = sum(isinstance(a, ast.Name) and a.id in kinds for c in _calls(function, functions) for a in c.args)
    return uses == indexed + handed


def _element_of(node: ast.Subscript, kinds: Mapping[str, str]) -> str | None:
    """The array of ``array[index]`` that can be rewritten, else None: shared arrays need a literal index."""
    if not (isinstance(node.value, ast.Name) and node.value.id in kinds):
        return None
    if kinds[node.value.id] == SHARED:
        readable = _literal(node) in (0, 1, 2) and isinstance(node.ctx, ast.Load)
    else:
        readable = not isinstance(node.slice, ast.Slice | ast.Tuple)
    return node.value.id if readable else None


def _literal(node: ast.Subscript) -> int | None:
    """The index if it is written as a whole number."""
    index = node.slice.value if isinstance(node.slice, ast.Constant) else None
    return index if isinstance(index, int) else None


class _Rewrite(ast.NodeTransformer):
    """Array elements to elements of ``BATCH_`` or to numbers, calls with the leading arguments."""

    def __init__(
        self, own: Mapping[str, str], kinds: Kinds, functions: Mapping[str, ast.FunctionDef], fixed: Mapping[int, float]
    ) -> None:
        self.own = own
        self.kinds = kinds
        self.functions = functions
        self.fixed = fixed

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        name = _element_of(node, self.own)
        if name is None:
            return node
        index = _literal(node)
        if self.own[name] == SHARED:
            return ast.Name(f"{name}_{index}", ast.Load())
        if name == "params" and index is not None and index in self.fixed:
            return ast.Constant(self.fixed[index])
        row = ast.BinOp(ast.Name(name, ast.Load()), ast.Add(), node.slice)
        at = ast.BinOp(ast.BinOp(row, ast.Mult(), ast.Name(SETS, ast.Load())), ast.Add(), ast.Name(SET, ast.Load()))
        return ast.Subscript(ast.Name(BATCH, ast.Load()), at, node.ctx)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if _called(node) in self.functions:
            names = [_spelled(a.id, self.own) if isinstance(a, ast.Name) else None for a in node.args]
            node.args = [
                n
                for given, spelled in zip(node.args, names, strict=True)
                for n in ([ast.Name(s, ast.Load()) for s in spelled] if spelled else [self.visit(given)])
            ]
            node.args[:0] = [ast.Name(a, ast.Load()) for a in LEADING]
            return node
        return self.generic_visit(node)


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
ENTRY = {"turn_vector_back": {0: ROW}, "step": {0: ROW, 1: ROW, 3: SHARED, 4: SHARED, 5: ROW}}


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
            found = run.with_line(
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
    wanted = beside and call.jit_wanted() and len(samples.t)
    advance = batch_kernel(estimator, switches, dtype) if wanted else None
    if advance is None:
        return [run.run(estimator, samples, v, q0, every, aids) for v in values]
    width, count = WIDTH[dtype], len(values)
    cast = {name: np.ascontiguousarray(getattr(samples, name), dtype) for name in ("dt", "gyr")}
    acc, mag, use = lagged_samples(samples, estimator.vectors_at)
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
    return [run.collect(estimator, samples, rows, one, v, silent) for one, v in zip(by_set, values, strict=False)]


def batch_kernel(estimator: Estimator, switches: Mapping[int, float], dtype: str) -> Any:
    """The compiled loop over samples and sets; None if there is no step or it cannot be rewritten for several sets."""
    if estimator.step is None or estimator.aided or run.not_compiled(estimator):
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
        name,
        "advance",
        text,
        SIGNATURE.format("f4" if dtype == "float32" else "f8"),
        what,
        KERNEL_SOURCES if ours else (),
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
    from attlog.estimators.vectors import turn_vector_back

    single = dtype == "float32"
    functions = generate.with_helpers({"turn_vector_back": turn_vector_back, "step": step}, jit=False, single=single)
    constants, _, rest = functions.partition("def ")
    rewritten = expand("def " + rest, ENTRY, dict(switches))
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
