"""Compile a loop to object code that runs without numba, load it, and call it.

``numba.cfunc`` compiles an entry of plain pointers and lengths, ``inspect_llvm`` returns its code, llvmlite parses that
and emits an object file. The entry still holds the way out of a Python exception. Where LLVM can show that none is
raised (loops divide as numpy does and allocate nothing) it is dropped with all that only numba's process has.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

from attlog.core.errors import AttlogError
from attlog.core.jit import store
from attlog.core.jit.loops import Argument, Call, Group, Loop, used_globals, with_globals

LOG = logging.getLogger("attlog.compiling")
# Operations of LLVM that become calls of the library's function of that name, on doubles.
CALLED_OPERATIONS = frozenset("cos exp exp2 fma log log10 log2 memcpy memmove memset pow powi sin sincos tan".split())
# Operations of LLVM that become instructions.
INSTRUCTIONS = frozenset(
    "abs assume bitreverse bswap ceil copysign ctlz ctpop cttz experimental fabs floor fshl fshr lifetime masked "
    "maximum maxnum minimum minnum nearbyint prefetch rint round roundeven sadd scmp smax smin smul sqrt ssub trunc "
    "uadd ucmp umax umin umul usub vector x86".split()
)
# What a loop may call: functions of the C library, which every process has.
C_LIBRARY = frozenset(
    "acos acosf asin asinf atan atan2 atan2f atanf cbrt ceil copysign cos cosf cosh erf exp exp2 expf expm1 fabs "
    "floor fmax fmin fmod hypot log log10 log1p log2 logf memcpy memmove memset nearbyint pow powf rint round sin "
    "sincos sinf sinh sqrt tan tanf tanh trunc".split()
)

# numba's dispatchers of functions: loops share helpers.
COMPILABLE: dict[FunctionType, Any] = {}


class NeedsNumba(AttlogError):
    """A loop needs more than the C library when it runs."""


def obtain(loop: Loop[Any, Any]) -> Callable[..., Any]:
    """Return a loop's machine code, from its object file where there is one, else compiled and kept.

    The logger ``attlog.compiling`` says what is compiled. Raises what numba does where it cannot compile the text.
    """
    found = at_hand(loop)
    if found is not None:
        return found
    own = store.own_place()
    where = f"once; kept in {own}" if own else "at every start: no cache folder can be written"
    LOG.info("compiling %s (%s)", loop.what, where)
    try:
        made = object_code(loop)
    except NeedsNumba as error:
        from numba import njit

        LOG.warning("%s is compiled at every start: %s", loop.what, error)
        called: Callable[..., Any] = njit(error_model="numpy")(compilable(loop.function).py_func)
        return called
    if not loop.edited:
        store.keep(loop.key, made)
    return load(loop, made)


def at_hand(loop: Loop[Any, Any]) -> Call | None:
    """Return a loop's machine code if its object file exists; None where it would have to be compiled."""
    found = store.find(loop.key)
    return load(loop, found) if found is not None and loadable(found.needs) else None


def object_code(loop: Loop[Any, Any]) -> store.ObjectCode:
    """Compile a loop. NeedsNumba where its code needs more than this machine's C library."""
    symbol = f"attlog_{loop.key}"
    code, needs = emit(_cfunc(loop).inspect_llvm(), symbol)
    if not loadable(needs):
        raise NeedsNumba(f"this system lacks one of {', '.join(needs)}")
    return store.ObjectCode(symbol, needs, code)


def compilable(function: FunctionType) -> Any:
    """Return numba's dispatcher of a function, the functions that it uses compiled as well, once in a process."""
    from numba import njit

    if function not in COMPILABLE:
        used = used_globals(function)
        helpers = {name: compilable(x) for name, x in used.items() if isinstance(x, FunctionType)}
        # Nothing is called from Python: such entry points cost a quarter of the time.
        options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        COMPILABLE[function] = njit(error_model="numpy", **options)(with_globals(function, helpers))
    return COMPILABLE[function]


def _cfunc(loop: Loop[Any, Any]) -> Any:
    """Compile a loop behind an entry of pointers, lengths and numbers."""
    from numba import carray, cfunc, types  # type: ignore[attr-defined]

    arguments, result = loop.signature
    names: list[str] = []
    kinds: list[Any] = []
    pointer: Any = types.CPointer
    known: dict[str, Any] = {"carray": carray, "loop": compilable(loop.function)}

    def given(argument: Argument) -> str:
        if isinstance(argument, Group):
            known[argument.made.__name__] = argument.made
            return f"{argument.made.__name__}({', '.join(map(given, argument.fields))})"
        own = f"p{len(names)}"
        lengths = [f"{own}_{d}" for d in range(argument.dimensions)]
        names.extend([own, *lengths])
        if lengths:
            kinds.extend([pointer(getattr(types, argument.kind)), *[types.i8] * len(lengths)])
            return f"carray({own}, ({', '.join(lengths)},))"
        kinds.append(types.i8 if argument.kind == "b1" else getattr(types, argument.kind))
        return f"{own} != 0" if argument.kind == "b1" else own

    values = ", ".join(map(given, arguments))
    exec(f"def entry({', '.join(names)}):\n    return loop({values})\n", known)
    return cfunc(getattr(types, result)(*kinds), error_model="numpy")(known["entry"])


def emit(text: str, symbol: str) -> tuple[bytes, tuple[str, ...]]:
    """Return the object file of a cfunc's LLVM text, and the functions of the C library that it calls."""
    import llvmlite.binding as llvm

    _native()
    module = llvm.parse_assembly(text)
    # numba counts what it compiles in its names; without them the same text gives the same bytes.
    for number, thing in enumerate([*module.functions, *module.global_variables]):
        if not thing.is_declaration:
            if thing.name.startswith("cfunc."):
                thing.name = symbol
            else:
                thing.linkage = "internal"
                thing.name = f"part{number}"
    name, features = store.target()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=3, reloc="pic", codemodel="jitdefault", jit=True
    )
    # Only now is all of it internal to one module: LLVM inlines what is called once, and drops what is never reached.
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, False  # as numba does
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    needs = needed([f.name for f in module.functions if f.is_declaration])
    foreign = [g.name for g in module.global_variables if g.is_declaration]
    if foreign:
        raise NeedsNumba(f"its code needs {', '.join(foreign)}")
    return machine.emit_object(module), needs


def needed(declared: list[str]) -> tuple[str, ...]:
    """Return the C library's functions among those that a module declares. NeedsNumba where it declares others."""
    found = set()
    for name in declared:
        operation = name.split(".")[1] if name.startswith("llvm.") else ""
        if operation.startswith("mem") or (operation in CALLED_OPERATIONS and name.endswith(".f64")):
            found.add(operation)
        elif name in C_LIBRARY:
            found.add(name)
        elif operation not in INSTRUCTIONS:
            raise NeedsNumba(f"its code needs {name}")
    return tuple(sorted(found))


@lru_cache(maxsize=1)
def _native() -> Any:
    """Return LLVM's knowledge of this machine, set up once."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine(jit=True))  # opens the C library
    return target


def loadable(needs: tuple[str, ...]) -> bool:
    """Return whether this process has these functions: LLVM ends the process where one is missing."""
    import llvmlite.binding as llvm

    _native()
    return all(llvm.address_of_symbol(name) for name in needs)


def load(loop: Loop[Any, Any], found: store.ObjectCode) -> Call:
    """Load an object file, by llvmlite alone."""
    import llvmlite.binding as llvm

    unused = llvm.parse_assembly("")
    engine = llvm.create_mcjit_compiler(unused, _native().create_target_machine(jit=True))
    engine.remove_module(unused)  # else it is compiled: 0.6 ms
    engine.add_object_file(llvm.ObjectFileRef.from_data(found.code))
    engine.finalize_object()
    return Call(loop, engine.get_function_address(found.symbol), engine)
