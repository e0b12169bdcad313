"""A filter's functions rewritten for many parameter sets: the same arithmetic, side by side in one array.

Two kinds of array arguments disappear. One that differs between the sets (``state``,
``params``, ``mag``) becomes a row number of one array ``BATCH_`` of ``SETS_`` columns:
``state[i]`` turns into ``BATCH_[(state + i) * SETS_ + set_]``, so that the loop over sets reads
and writes neighbours, which is what the compiler needs for vector registers. One that
all sets share (``gyr``, ``acc``) becomes three numbers, ``acc[0]`` turns into ``acc_0``.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping

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
