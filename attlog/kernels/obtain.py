"""From a kernel to a function: its object where it is at hand, else compiled, else as numba alone can run it.

numba is imported only to compile. ``ATTLOG_NO_JIT=1`` asks for plain Python; whoever owns a kernel heeds it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from attlog.kernels import cache, calling, emit, store
from attlog.kernels.folder import folder
from attlog.kernels.kernel import Kernel

COMPILING = logging.getLogger("attlog.compiling")


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
    COMPILING.info("compiling %s (%s)", kernel.what, where)
    try:
        made = made_object(kernel, key)
    except emit.NeedsNumba as error:
        COMPILING.warning("%s cannot run without numba: %s", kernel.what, error)
        return by_numba(kernel)
    store.keep(key, made)
    store.learn_key(kernel, key)
    return calling.load(kernel, made.code, made.symbol)


def at_hand(kernel: Kernel) -> Callable[..., Any] | None:
    """The kernel if its object exists already; None where it would have to be compiled."""
    known = store.known_key(kernel)
    key = known or store.key_of(kernel)
    found = store.find(key)
    if found is None or not calling.loadable(found.needs):
        return None
    if known is None:
        store.learn_key(kernel, key)
    return calling.load(kernel, found.code, found.symbol)


def made_object(kernel: Kernel, key: str) -> store.Object:
    """The kernel's object, compiled now. NeedsNumba where it would need more than this machine's C library."""
    symbol = f"attlog_{key}"
    code, needs = emit.emit(kernel, symbol)
    if not calling.loadable(needs):
        raise emit.NeedsNumba(f"this system lacks one of {', '.join(needs)}")
    return store.Object(symbol, needs, code)


def by_numba(kernel: Kernel) -> Callable[..., Any]:
    """The kernel as numba's dispatcher calls it, as plug-ins have it."""
    function = cache.compiled(kernel.decorated(), kernel.entry, kernel.what)
    if not kernel.scratch:
        return function
    return lambda *values: function(*values, *kernel.room())
