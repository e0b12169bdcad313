"""Which kernels are compiled when the package is built, so that a fresh machine has them at once.

``python -m attlog.prebuilt FOLDER``, run by the build hook once for each level of processor (:data:`LEVEL`), writes
their object files and the index that knows them by the state of the source files.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from attlog.kernels import emit, processor, sources, store
from attlog.kernels.folder import write
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import made_object

LEVEL = "NUMBA_CPU_NAME"
"""numba's own variable: the processor to compile for. numba takes no features of this machine where it is set."""


def kernels() -> Iterator[Kernel]:
    """The loops of all built-in filters, of the readers and, where its packages are there, of the simulator."""
    from attlog.estimators import get
    from attlog.estimators.engine.loop import kernel_of
    from attlog.estimators.filters.inertial.backward import RECORD_KERNEL
    from attlog.estimators.filters.navigation.kernels import BACKWARD_KERNEL, FORWARD_KERNEL
    from attlog.estimators.registry import BUILT_IN
    from attlog.formats.mavlink.compiled import WALK
    from attlog.formats.ulog import index

    yield from (kernel_of(e) for e in map(get, BUILT_IN) if e.step is not None)
    yield from (FORWARD_KERNEL, BACKWARD_KERNEL, RECORD_KERNEL, index.WALK, index.COUNT, index.SCATTER, WALK)
    try:
        from attlog.simulate import controller, rigid_body, wind
        from attlog.simulate.sensors import imu
    except ImportError:  # built alone: the simulator reads its scenarios with pydantic
        return
    yield from (controller.KERNEL, rigid_body.KERNEL, wind.KERNEL, imu.KERNEL)


def build(target: Path) -> None:
    """Write what is not there yet below ``target``. Raises what the compiler does; what needs numba is left out."""
    place = target / f"{processor.machine()}-{os.environ[LEVEL]}"
    place.mkdir(parents=True, exist_ok=True)
    keys: dict[str, dict[str, str]] = {}
    kept = set()
    for kernel in kernels():
        key = store.key_of(kernel)
        path = place / f"{key}.o"
        try:
            if not path.is_file() or store.unpacked(path.read_bytes()) is None:
                write(path, made_object(kernel, key).packed())
        except emit.NotAlone as error:
            print(f"{kernel.what} is compiled at its first use: {error}", file=sys.stderr)
            continue
        keys.setdefault(sources.state(kernel.sources), {})[kernel.name] = key
        kept.add(path)
    for old in set(place.glob("*.o")) - kept:
        old.unlink()
    write(target / store.INDEX, json.dumps({"format": store.FORMAT, "keys": keys}, indent=1, sort_keys=True).encode())


if __name__ == "__main__":
    build(Path(sys.argv[1]))
