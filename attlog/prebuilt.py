"""Which kernels are compiled when the package is built, so that a fresh machine has them at once.

``python -m attlog.prebuilt FOLDER`` (the build hook runs it) writes object files for every level of processor that is
shipped here, ``--here`` for this machine's own level alone, and the index that knows them by the state of the sources.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from attlog.kernels import emit, processor, sources, store
from attlog.kernels.folder import write
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import made_object

LEVEL = "NUMBA_CPU_NAME"
"""numba's own variable: the processor to compile for. numba takes no features of this machine where it is set."""
Keys = dict[str, dict[str, str]]
"""Keys of objects by the state of the sources and the kernel's name."""


def kernels() -> Iterator[Kernel]:
    """The loops of all built-in filters, readers and metrics and, where its packages are there, of the simulator."""
    from attlog.base.interpolation import INTERPOLATED
    from attlog.estimators import get
    from attlog.estimators.engine.loop import kernel_of
    from attlog.estimators.filters.inertial.backward import RECORD_KERNEL
    from attlog.estimators.filters.inertial.recursion import RECURSION_KERNEL
    from attlog.estimators.filters.navigation.kernels import AHEAD_KERNEL, BACKWARD_KERNEL, CHAIN_KERNEL, FORWARD_KERNEL
    from attlog.estimators.registry import BUILT_IN
    from attlog.formats import grouping, mapping
    from attlog.formats.dataflash import compiled as dataflash
    from attlog.formats.mavlink import compiled as mavlink
    from attlog.formats.ulog import index
    from attlog.metrics.evidence import aiding_loop
    from attlog.metrics.figures import envelope_loop
    from attlog.metrics.noise import loops as noise_loop
    from attlog.metrics.steps import turning_loop
    from attlog.metrics.steps.fit import loops as step_loops
    from attlog.segments import increments

    yield from (kernel_of(e) for e in map(get, BUILT_IN) if e.step is not None)
    yield from (
        FORWARD_KERNEL,
        BACKWARD_KERNEL,
        AHEAD_KERNEL,
        CHAIN_KERNEL,
        RECORD_KERNEL,
        RECURSION_KERNEL,
        mapping.COPY,
        grouping.COUNT,
        grouping.SCATTER,
        index.WALK,
        mavlink.WALK,
        mavlink.PAYLOAD,
        dataflash.WALK,
        aiding_loop.HELD,
        aiding_loop.SEEN,
        aiding_loop.SUMMED,
        step_loops.PRODUCTS,
        step_loops.POWERS,
        envelope_loop.EXTREMES,
        noise_loop.AT_REST,
        noise_loop.PUSHED,
        turning_loop.SUMMED,
        turning_loop.ABOUT,
        INTERPOLATED,
        increments.SUMMED,
        increments.BETWEEN,
    )
    try:
        from attlog.simulate.autopilot import controller
        from attlog.simulate.physics import rigid_body, wind
        from attlog.simulate.sensors import imu
    except ImportError:  # built alone: the simulator reads its scenarios with pydantic
        return
    yield from (controller.KERNEL, rigid_body.KERNEL, wind.KERNEL, imu.KERNEL)


def build(target: Path, levels: tuple[str, ...]) -> None:
    """Write objects for the levels and the index, in as many processes as there are processors.

    RuntimeError with the last line of what a compiler said that failed.
    """
    parts = max((os.cpu_count() or 1) // len(levels), 1)
    running = []
    for level in levels:
        for part in range(parts):
            command = [sys.executable, "-m", "attlog.prebuilt", str(target), f"{part}/{parts}"]
            # The order in which numba goes through sets shows in the code: unfixed, two builds differ in some bytes.
            environment = {**os.environ, LEVEL: level, "PYTHONHASHSEED": "0"}
            environment.pop("NUMBA_CPU_FEATURES", None)
            running.append(subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
    told = [(process, *process.communicate()) for process in running]
    keys: Keys = {}
    for process, out, err in told:
        if process.returncode:
            raise RuntimeError((err.decode(errors="replace").strip().splitlines() or ["no reason given"])[-1])
        for state, found in json.loads(out).items():
            keys.setdefault(state, {}).update(found)
    kept = {f"{key}.o" for found in keys.values() for key in found.values()}
    for old in target.glob("*/*.o"):
        if old.name not in kept:
            old.unlink()
    index = {"format": store.FORMAT, "keys": keys}
    _write(target / store.INDEX, json.dumps(index, indent=1, sort_keys=True).encode())


def compiled(place: Path, part: int, parts: int) -> Keys:
    """Write one part of the objects for the processor that :data:`LEVEL` names, where they are not there yet."""
    keys: Keys = {}
    place.mkdir(parents=True, exist_ok=True)
    for kernel in list(kernels())[part::parts]:
        key = store.key_of(kernel)
        path = place / f"{key}.o"
        if not path.is_file() or store.unpacked(path.read_bytes()) is None:
            try:
                _write(path, made_object(kernel, key).packed())
            except emit.NotAlone as error:
                print(f"{kernel.what} will be compiled at its first use: {error}", file=sys.stderr)
                continue
        keys.setdefault(sources.state(kernel.sources), {})[kernel.name] = key
    return keys


def _write(path: Path, content: bytes) -> None:
    """What is shipped is read by everybody."""
    write(path, content)
    path.chmod(0o644)


def main(arguments: list[str]) -> None:
    """See the head of this file."""
    target = Path(arguments[0])
    asked = arguments[1] if len(arguments) > 1 else ""
    if "/" in asked:
        part, parts = map(int, asked.split("/"))
        place = target / f"{processor.machine()}-{os.environ[LEVEL]}"
        print(json.dumps(compiled(place, part, parts)))
    else:
        target.mkdir(parents=True, exist_ok=True)
        build(target, processor.levels()[:1] if asked == "--here" else processor.portable())


if __name__ == "__main__":
    main(sys.argv[1:])
