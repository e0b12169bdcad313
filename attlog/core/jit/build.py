"""Which kernels are compiled before they are run, so that a fresh machine has them at once.

``python -m attlog.core.jit.build [FOLDER] [--here] [--all]`` (the build hook and ``make`` run it) writes object files into
the package or ``FOLDER``, and the index that knows them by the state of the sources: for every level of processor that
is shipped here, with ``--here`` for this machine's own level alone; those that ``analyze`` needs with its defaults,
with ``--all`` all of them. What is left out is compiled at its first use, which says so. What is there already stays.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from attlog.core.jit import compile, store
from attlog.core.jit.compile import made_object
from attlog.core.jit.kernel import Kernel
from attlog.core.jit.store import write

LEVEL = "NUMBA_CPU_NAME"
"""numba's own variable: the processor to compile for. numba takes no features of this machine where it is set."""
MADE = "made"
"""What a compiling process says of each object."""


def of_defaults() -> Iterator[Kernel]:
    """What ``analyze`` runs where nothing else is asked for: its filters, the smoother, all readers and metrics."""
    from attlog.core.rotation import SLERP_KERNEL
    from attlog.estimators import get
    from attlog.estimators.api import DEFAULT
    from attlog.estimators.filters.navigation import backward, forward, turns
    from attlog.estimators.run import kernel_of_step
    from attlog.formats import file_bytes
    from attlog.formats.dataflash import walk as dataflash
    from attlog.formats.mavlink import walk as mavlink
    from attlog.formats.ulog import walk
    from attlog.metrics import correction_noise, noise, step_products, step_sensors, step_turning, trace
    from attlog.segments import increments

    yield from (kernel_of_step(e) for e in map(get, DEFAULT) if e.step is not None)
    yield from (
        forward.FORWARD_KERNEL,
        backward.BACKWARD_KERNEL,
        turns.AHEAD_KERNEL,
        turns.CHAIN_KERNEL,
        file_bytes.COPY_KERNEL,
        file_bytes.COUNT_KERNEL,
        file_bytes.SCATTER_KERNEL,
        walk.WALK_KERNEL,
        mavlink.WALK_KERNEL,
        mavlink.PAYLOAD_KERNEL,
        dataflash.FOLLOW_KERNEL,
        step_sensors.HELD,
        step_sensors.SEEN,
        step_sensors.SUMMED,
        step_products.PRODUCTS,
        step_products.POWERS,
        trace.EXTREMES,
        noise.AT_REST,
        correction_noise.CORRECTION_KERNEL,
        step_turning.SUMMED,
        step_turning.ABOUT,
        SLERP_KERNEL,
        increments.SUMMED,
        increments.BETWEEN,
    )


def kernels() -> Iterator[Kernel]:
    """Those, then of all built-in filters, of the smoother without GNSS and of the simulator."""
    from attlog.estimators import get
    from attlog.estimators.api import DEFAULT
    from attlog.estimators.filters.inertial.backward import RECORD_KERNEL
    from attlog.estimators.filters.inertial.recursion import RECURSION_KERNEL
    from attlog.estimators.registry import BUILT_IN
    from attlog.estimators.run import kernel_of_step

    yield from of_defaults()
    yield from (kernel_of_step(e) for e in map(get, BUILT_IN) if e.name not in DEFAULT and e.step is not None)
    yield from (RECORD_KERNEL, RECURSION_KERNEL)
    try:
        from attlog.simulate import controller, imu, rigid_body
        from attlog.simulate import environment as wind
    except ImportError:  # built alone: the simulator reads its scenarios with pydantic
        return
    yield from (controller.CONTROLLER_KERNEL, rigid_body.BODY_KERNEL, wind.WIND_KERNEL, imu.IMU_KERNEL)


def build(target: Path, levels: tuple[str, ...], every: bool = True) -> None:
    """Write objects for the levels and the index, in as many processes as there are processors; tell how far it is.

    ``every``: of all kernels, else of those of the defaults. RuntimeError with the last line of what a compiler said
    that failed.
    """
    target.mkdir(parents=True, exist_ok=True)
    known = {kernel.name: (kernel, store.key_of(kernel)) for kernel in kernels()}
    chosen = list(kernels() if every else of_defaults())
    waiting = sum(_lacks(_place(target, level) / f"{known[k.name][1]}.o") for level in levels for k in chosen)
    if waiting:
        parts = max((os.cpu_count() or 1) // len(levels), 1)
        print(f"compiling {waiting} loops of filters, readers and metrics, half a minute to two:", end="", flush=True)
        _compile_in_processes(target, levels, parts, every)
    valid = {f"{key}.o" for _, key in known.values()}
    for old in target.glob("*/*.o"):
        if old.name not in valid:
            old.unlink()
    keys: dict[str, dict[str, str]] = {}
    for kernel, key in known.values():
        if any(target.glob(f"*/{key}.o")):
            keys.setdefault(store.sources_state(kernel.sources), {})[kernel.name] = key
    index = {"format": store.FORMAT, "keys": keys}
    _write(target / store.INDEX, json.dumps(index, indent=1, sort_keys=True).encode())


def _compile_in_processes(target: Path, levels: tuple[str, ...], parts: int, every: bool) -> None:
    """One process for each level and part; each object that it says it made is counted on the line that stands."""
    counted, count = threading.Lock(), 0

    def run(level: str, part: int) -> tuple[int, str]:
        nonlocal count
        command = [sys.executable, "-m", "attlog.core.jit.build", str(target), "--share", str(part), str(parts)]
        command += ["--all"] if every else []
        # The order in which numba goes through sets shows in the code: unfixed, two builds differ in some bytes.
        environment = {**os.environ, LEVEL: level, "PYTHONHASHSEED": "0"}
        environment.pop("NUMBA_CPU_FEATURES", None)
        with subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
        ) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                if line.startswith(MADE):
                    with counted:
                        count += 1
                        print(f" {count}", end="", flush=True)
            said = process.stderr.read()
        return process.returncode, said

    jobs = [(level, part) for level in levels for part in range(parts)]
    with ThreadPoolExecutor(len(jobs)) as pool:
        ended = list(pool.map(run, *zip(*jobs, strict=True)))
    print(flush=True)
    for code, said in ended:
        if code:
            raise RuntimeError((said.strip().splitlines() or ["no reason given"])[-1])
        print(said, end="", file=sys.stderr)


def compile_share(place: Path, part: int, parts: int, every: bool) -> None:
    """Write the objects of one share for the processor that :data:`LEVEL` names, where they are not there yet."""
    place.mkdir(parents=True, exist_ok=True)
    for kernel in _share(list(kernels() if every else of_defaults()), part, parts):
        key = store.key_of(kernel)
        path = place / f"{key}.o"
        if _lacks(path):
            try:
                _write(path, made_object(kernel, key).packed())
                print(MADE, kernel.name, flush=True)
            except compile.NeedsNumba as error:
                print(f"{kernel.what} will be compiled at its first use: {error}", file=sys.stderr)


def _share(chosen: list[Kernel], part: int, parts: int) -> list[Kernel]:
    """What one of several processes compiles: the longest text goes to the one that has least so far."""
    shares: list[list[Kernel]] = [[] for _ in range(parts)]
    load = [0] * parts
    for kernel in sorted(chosen, key=lambda k: len(k.text()), reverse=True):
        least = load.index(min(load))
        shares[least].append(kernel)
        load[least] += len(kernel.text())
    return shares[part]


def _place(target: Path, level: str) -> Path:
    return target / f"{store.machine()}-{level}"


def _lacks(path: Path) -> bool:
    """Whether there is no sound object at ``path``."""
    return not path.is_file() or store.unpacked(path.read_bytes()) is None


def _write(path: Path, content: bytes) -> None:
    """What is shipped is read by everybody."""
    write(path, content)
    path.chmod(0o644)


def main() -> None:
    """See the head of this file."""
    options = argparse.ArgumentParser(prog="python -m attlog.core.jit.build", description=__doc__)
    options.add_argument("folder", nargs="?", type=Path, default=store.SHIPPED)
    options.add_argument("--here", action="store_true")
    options.add_argument("--all", action="store_true")
    options.add_argument("--share", nargs=2, type=int, metavar=("PART", "PARTS"), help="of a process of its own")
    asked = options.parse_args()
    if asked.share:
        part, parts = asked.share
        compile_share(_place(asked.folder, os.environ[LEVEL]), part, parts, asked.all)
    else:
        build(asked.folder, store.levels()[:1] if asked.here else store.portable(), asked.all)


if __name__ == "__main__":
    main()
