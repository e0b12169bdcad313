"""The source of a kernel: an estimator's functions and everything they use, plus a loop.

A generated module stands alone, so numba compiles and caches one function with one
signature, and the same text without decorators is the plain Python twin.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

from attlog.base.errors import PluginError

INLINE = "@njit(forceinline=True, error_model='numpy', no_cpython_wrapper=True, no_cfunc_wrapper=True)\n"
"""Only the loop is called from Python: compiling entry points for its helpers costs a quarter of the time."""


def with_helpers(functions: Mapping[str, Callable[..., Any]], jit: bool, single: bool = False) -> str:
    """Source text that defines ``functions`` by name and, before them, all globals they need.

    ``jit`` puts numba's decorator on each; ``single`` writes float literals as float32.
    PluginError for a global that cannot be written down (an object, a closure).
    """
    parts: dict[str, str] = {}
    for name, function in functions.items():
        _collect(name, function, parts, jit, single)
    return "\n".join(parts.values())


def _collect(name: str, value: Any, parts: dict[str, str], jit: bool, single: bool) -> None:
    """Add what defines ``name`` to ``parts``, its own needs first."""
    value = getattr(value, "py_func", value)
    if isinstance(value, ModuleType):
        text = f"import {value.__name__} as {name}\n"
    elif isinstance(value, bool | int | str | tuple):
        text = f"{name} = {value!r}\n"
    elif isinstance(value, float):
        text = f"{name} = np.float32({value!r})\n" if single else f"{name} = {value!r}\n"
    elif isinstance(value, FunctionType):
        text = _function(name, value, parts, jit, single)
    elif isinstance(value, BuiltinFunctionType | type) and getattr(value, "__module__", None) in ("math", "numpy"):
        text = f"from {value.__module__} import {value.__name__} as {name}\n"
    else:
        raise PluginError(
            f"the kernel uses {name}, a {type(value).__name__}; "
            "use numbers, functions and the modules math and numpy only"
        )
    if parts.setdefault(name, text) != text:
        raise PluginError(f"two different things are called {name} in an estimator and its helpers; rename one")


def _function(name: str, function: FunctionType, parts: dict[str, str], jit: bool, single: bool) -> str:
    """The text of a function without its decorators; its globals go to ``parts`` first."""
    code = function.__code__
    if code.co_freevars:
        raise PluginError(f"{code.co_filename}, line {code.co_firstlineno}: {name} uses variables of an outer function")
    for used in sorted(_global_names(code)):
        if used in function.__globals__ and used != name:
            _collect(used, function.__globals__[used], parts, jit, single)
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef):
        raise PluginError(f"{code.co_filename}, line {code.co_firstlineno}: {name} is not a plain function")
    definition.name = name
    definition.decorator_list = []
    definition.returns = None
    for argument in definition.args.args:
        argument.annotation = None
    if jit:
        whole = {n for n in _global_names(code) if type(function.__globals__.get(n)) is int}
        ours = {n for n in _global_names(code) if isinstance(function.__globals__.get(n), FunctionType)}
        definition = ast.fix_missing_locations(_PlainIntegers(whole - set(code.co_varnames), ours).visit(definition))
    if single:
        definition = ast.fix_missing_locations(_SinglePrecision().visit(definition))
    return (INLINE if jit else "") + ast.unparse(definition) + "\n"


def _global_names(code: Any) -> set[str]:
    """Names that the code and the code nested in it look up outside."""
    nested = [c for c in code.co_consts if inspect.iscode(c)]
    return set(code.co_names).union(*(_global_names(c) for c in nested))


class _SinglePrecision(ast.NodeTransformer):
    """Writes float literals as float32, so that no expression widens to float64."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if not isinstance(node.value, float):
            return node
        return ast.Call(ast.Attribute(ast.Name("np", ast.Load()), "float32", ast.Load()), [node], [])


class _PlainIntegers(ast.NodeTransformer):
    """Hands whole numbers, written out or constants by name, to our own functions as integers of 64 bit.

    numba compiles a function anew for every whole number that it is called with as it stands.
    """

    def __init__(self, constants: set[str], functions: set[str]) -> None:
        self.constants = constants
        self.functions = functions

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self.functions:
            node.args = [self._plain(a) for a in node.args]
        return node

    def _plain(self, argument: ast.expr) -> ast.expr:
        written = isinstance(argument, ast.Constant) and type(argument.value) is int
        if not written and not (isinstance(argument, ast.Name) and argument.id in self.constants):
            return argument
        return ast.Call(ast.Attribute(ast.Name("np", ast.Load()), "int64", ast.Load()), [argument], [])
