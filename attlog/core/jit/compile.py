"""Object code of a kernel, made with numba and verified to run without it.

The supported way: ``numba.cfunc`` compiles an entry of plain pointers and lengths, ``inspect_llvm`` shows its code,
llvmlite parses that and emits an object file. The entry still holds the way out of a Python exception; where LLVM can
show that no exception is raised (our kernels divide as numpy does and allocate nothing), it is dropped together with
all that only the compiler's process knows.
"""

from __future__ import annotations

import ast
import logging
from collections.abc import Callable
from typing import Any

from attlog.core.errors import AttlogError
from attlog.core.jit import call, store
from attlog.core.jit.kernel import Kernel
from attlog.core.jit.store import folder, target

ENTRY_HEADER = "import math\n\nimport numpy as np\n"
LIBRARY = frozenset(
    "acos acosf asin asinf atan atan2 atan2f atanf cbrt ceil copysign cos cosf cosh erf exp exp2 expf expm1 fabs "
    "floor fmax fmin fmod hypot log log10 log1p log2 logf memcpy memmove memset nearbyint pow powf rint round sin "
    "sincos sinf sinh sqrt tan tanf tanh trunc".split()
)
"""What a kernel may call: functions of the C library, which every process has."""
MACHINE = frozenset(
    "abs assume bitreverse bswap ceil copysign ctlz ctpop cttz experimental fabs floor fshl fshr lifetime masked "
    "maximum maxnum memcpy memmove memset minimum minnum nearbyint prefetch rint round roundeven sadd scmp smax smin "
    "smul sqrt ssub trunc uadd ucmp umax umin umul usub "
    "vector x86".split()
)
"""Operations of LLVM that become instructions (memcpy and its like: a call of the library)."""
ALSO_CALLS = frozenset("cos exp exp2 fma log log10 log2 pow powi sin sincos tan".split())
"""Operations of LLVM that become calls of the library's function of that name, on doubles; others are refused."""


class NeedsNumba(AttlogError):
    """A kernel that needs more than the C library when it runs."""


def emit(kernel: Kernel, symbol: str) -> tuple[bytes, tuple[str, ...]]:
    """The object file that defines ``symbol``, and the library's functions that it calls.

    NeedsNumba where something else would be needed, naming it; what numba raises where it cannot compile the text.
    """
    return objectified(cfunc(kernel).inspect_llvm(), symbol)


def cfunc(kernel: Kernel) -> Any:
    """The kernel compiled by numba behind an entry of pointers and lengths."""
    namespace: dict[str, Any] = {}
    exec(compile(entry_text(kernel), f"<attlog kernel {kernel.name}>", "exec"), namespace)
    return namespace["entry_"]


def entry_text(kernel: Kernel) -> str:
    """The kernel's module, its entry taking pointers and lengths.

    The entry makes its arrays itself: a second function around the first would have all of it optimised twice.
    """
    head, text = kernel.parts()
    entry = ast.parse(text).body[0]
    assert isinstance(entry, ast.FunctionDef)
    names, types, given = [], [], []
    for i, argument in enumerate(kernel.arguments):
        if argument.dimensions:
            sizes = [f"n{i}_{d}_" for d in range(argument.dimensions)]
            names += [f"p{i}_", *sizes]
            types += [f"types.CPointer(types.{argument.kind})", *["types.i8"] * argument.dimensions]
            given.append(f"carray(p{i}_, ({', '.join(sizes)},))")
        else:
            names.append(f"p{i}_")
            types.append(f"types.{'i8' if argument.kind == 'b1' else argument.kind}")
            given.append(f"p{i}_ != 0" if argument.kind == "b1" else f"p{i}_")
    arrays = (f"{a.arg} = {g}" for a, g in zip(entry.args.args, given, strict=True))
    entry.body[:0] = ast.parse("\n".join(arrays)).body
    entry.name, entry.args.args = "entry_", [ast.arg(n) for n in names]
    return (
        f"{ENTRY_HEADER}from numba import carray, cfunc, njit, types\n\n{head}\n"
        f"@cfunc(types.{kernel.result}({', '.join(types)}), error_model='numpy')\n"
        f"{ast.unparse(ast.fix_missing_locations(entry))}\n"
    )


def objectified(text: str, symbol: str) -> tuple[bytes, tuple[str, ...]]:
    """LLVM's text of a compiled cfunc as an object file, see :func:`emit`."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(text)
    # numba counts what it compiles in its names; without them the same text gives the same bytes.
    for number, thing in enumerate([*module.functions, *module.global_variables]):
        if not thing.is_declaration:
            if thing.name.startswith("cfunc."):
                thing.name = symbol
            else:
                thing.linkage = "internal"
                thing.name = f"part{number}"
    name, features = target()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=3, reloc="pic", codemodel="jitdefault", jit=True
    )
    _clean(module, machine)
    needs = needed([f.name for f in module.functions if f.is_declaration])
    foreign = [g.name for g in module.global_variables if g.is_declaration]
    if foreign:
        raise NeedsNumba(f"the kernel needs {', '.join(foreign)}")
    return machine.emit_object(module), needs


def _clean(module: Any, machine: Any) -> None:
    """Drop what is never reached: that nothing is raised shows when constants are followed through calls."""
    import llvmlite.binding as llvm

    passes = llvm.create_new_module_pass_manager()
    if not hasattr(passes, "add_ipsccp_pass"):  # llvmlite 0.44 has it in the older pass manager only
        older = llvm.create_module_pass_manager()
        older.add_ipsccp_pass()
        older.add_cfg_simplification_pass()
        older.add_global_dce_pass()
        older.add_strip_dead_prototypes_pass()
        older.run(module)
        return
    passes.add_ipsccp_pass()
    passes.add_simplify_cfg_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))


def needed(declared: list[str]) -> tuple[str, ...]:
    """The library's functions among what a module declares. NeedsNumba where it declares more than these."""
    found = set()
    for name in declared:
        operation = name.split(".")[1] if name.startswith("llvm.") else ""
        if operation in ALSO_CALLS and name.endswith(".f64"):
            found.add(operation)
        elif name in LIBRARY:
            found.add(name)
        elif operation not in MACHINE:
            raise NeedsNumba(f"the kernel needs {name}")
        elif operation in ("memcpy", "memmove", "memset"):
            found.add(operation)
    return tuple(sorted(found))


# From a kernel to a function: its object where it is at hand, else compiled, else as numba alone can run it.
#
# numba is imported only to compile. ``ATTLOG_NO_JIT=1`` asks for plain Python; whoever owns a kernel heeds it.

COMPILING_LOG = logging.getLogger("attlog.compiling")


def obtained(kernel: Kernel) -> Callable[..., Any]:
    """The kernel as a function of arrays and numbers.

    The logger ``attlog.compiling`` tells that it is compiled, which takes seconds, and warns where numba has to stay.
    What numba raises where it cannot compile the text.
    """
    function = at_hand(kernel)
    if function is not None:
        return function
    key = store.key_of(kernel)
    kept = folder()
    where = f"once; kept in {kept}" if kept else "at every start: no cache folder can be written"
    COMPILING_LOG.info("compiling %s (%s)", kernel.what, where)
    try:
        made = made_object(kernel, key)
    except NeedsNumba as error:
        COMPILING_LOG.warning("%s cannot run without numba: %s", kernel.what, error)
        return by_numba(kernel)
    store.keep(key, made)
    store.learn_key(kernel, key)
    return call.load(kernel, made.code, made.symbol)


def at_hand(kernel: Kernel) -> Callable[..., Any] | None:
    """The kernel if its object exists already; None where it would have to be compiled."""
    known = store.known_key(kernel)
    key = known or store.key_of(kernel)
    found = store.find(key)
    if found is None or not call.loadable(found.needs):
        return None
    if known is None:
        store.learn_key(kernel, key)
    return call.load(kernel, found.code, found.symbol)


def made_object(kernel: Kernel, key: str) -> store.Object:
    """The kernel's object, compiled now. NeedsNumba where it would need more than this machine's C library."""
    symbol = f"attlog_{key}"
    code, needs = emit(kernel, symbol)
    if not call.loadable(needs):
        raise NeedsNumba(f"this system lacks one of {', '.join(needs)}")
    return store.Object(symbol, needs, code)


def by_numba(kernel: Kernel) -> Callable[..., Any]:
    """The kernel as numba's dispatcher calls it, as plug-ins have it."""
    function = call.compiled(kernel.decorated(), kernel.entry, kernel.what)
    if not kernel.scratch:
        return function
    return lambda *values: function(*values, *kernel.room())
