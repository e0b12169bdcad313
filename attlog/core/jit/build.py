"""Compile loops before they are run: for a wheel, an installation in place, or somebody's first run.

``python -m attlog.core.jit.build [FOLDER] [--here] [--all | --rows LIST]`` (the build hook and ``make`` run it) writes
object files into the package or ``FOLDER``. Without ``--here`` it compiles for every level of processor that is
shipped, else for this machine's; ``--all`` every loop, ``--rows`` what these estimators need, else what ``analyze``
needs with its defaults on logs of both firmwares. Objects that exist stay, missing ones are compiled at first use.
"""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Container, Iterable
from itertools import count
from pathlib import Path
from typing import Any

from attlog.core.jit import store
from attlog.core.jit.compile import LOG, NeedsNumba, object_code
from attlog.core.jit.loops import Loop
from attlog.core.machine import cores

# numba's own variable: the processor to compile for. It takes no features of this machine where it is set.
LEVEL = "NUMBA_CPU_NAME"
# A compiling process writes this before the name of each object that it has made.
MADE = "made"
# One core compiles about so many characters of a loop's text per second (24 loops, 250,000 characters: 65 s).
CHARACTERS_PER_S = 3500.0
# Modules whose loops run in each analysis, in those of logs of a firmware, and in other commands.
DEFAULTS = (
    "attlog.core.rotation",
    "attlog.estimators.filters.navigation.backward",
    "attlog.estimators.filters.navigation.forward",
    "attlog.estimators.filters.navigation.turns",
    "attlog.formats.mavlink.walk",
    "attlog.metrics.correction_noise",
    "attlog.metrics.noise",
    "attlog.metrics.step_products",
    "attlog.metrics.step_sensors",
    "attlog.metrics.step_turning",
    "attlog.metrics.trace",
    "attlog.segments.increments",
)
FLOWN = {
    "px4_ekf2": ("attlog.estimators.ekf2.loop", "attlog.estimators.ekf2.run"),
    "ap_ekf3": ("attlog.estimators.ekf3.loop",),
}
OTHERS = (
    "attlog.core.csv_rows",
    "attlog.estimators.filters.inertial.backward",
    "attlog.simulate.controller",
    "attlog.simulate.environment",
    "attlog.simulate.imu",
    "attlog.simulate.rigid_body",
)


def default_names() -> list[str]:
    """Return the loops that ``analyze`` runs with its defaults: filters, smoother, readers and metrics."""
    return names_for(["default", *FLOWN])


def names_for(rows: Iterable[str]) -> list[str]:
    """Return the loops that an analysis with these estimators runs.

    ``default``, ``all`` or ``NAME[@PRESET][:...]``; the filter that flew is not among ``default`` and ``all``.
    """
    from attlog.estimators.api import DEFAULT
    from attlog.estimators.registry import BUILT_IN

    named = {re.split("[@:]", item.strip())[0] for row in rows for item in row.split(",")}
    named |= set(DEFAULT) if "default" in named else set()
    own = _filters(name for name in BUILT_IN if name in named or "all" in named)
    return [*_names_in(DEFAULTS), *flown_names(named), *own]


def flown_names(filters: Container[str]) -> list[str]:
    """Return the loops of those of these filters that flew on board."""
    return _names_in(module for name, modules in FLOWN.items() if name in filters for module in modules)


def all_names() -> list[str]:
    """Return these, and those of all built-in filters, of the simulator and of other commands."""
    from attlog.estimators.registry import BUILT_IN

    return list(dict.fromkeys([*default_names(), *_names_in(OTHERS), *_filters(BUILT_IN)]))


def _names_in(modules: Iterable[str]) -> list[str]:
    found = {name: vars(importlib.import_module(name)) for name in modules}
    return [
        f"{m}:{n}" for m, own in found.items() for n, x in own.items() if isinstance(x, Loop) and x.name == f"{m}.{n}"
    ]


def _filters(names: Iterable[str]) -> list[str]:
    from attlog.estimators import get

    return [f"filter:{name}" for name in names if get(name).step is not None]


def loop_by_name(name: str) -> Loop[Any, Any]:
    """Return the loop of a name: ``module:function``, or ``filter:mekf`` for the loop around a filter's step."""
    module, _, function = name.partition(":")
    if module == "filter":
        from attlog.estimators import get
        from attlog.estimators.run import loop_of

        return loop_of(get(function))
    found: Loop[Any, Any] = getattr(importlib.import_module(module), function)
    return found


def prepare(names: Iterable[str], progress: Callable[[int, int], None]) -> None:
    """Compile the loops that are missing, on all cores, and keep them; a single one waits for its first use."""
    missing = [name for name in names if not store.has(loop_by_name(name).key)]
    if len(missing) > 1 and (own := store.own_place()) is not None:
        LOG.info("compiling %d loops, once, about %d s; kept in %s", len(missing), expected_s(missing), own)
        compile_all({own: ""}, missing, progress)


def expected_s(names: Iterable[str]) -> int:
    """Return about how long compiling takes on all cores."""
    return round(sum(len(loop_by_name(name).text) for name in names) / CHARACTERS_PER_S / cores()) + 2


def build(target: Path, levels: tuple[str, ...], chosen: Iterable[str]) -> None:
    """Write objects for the levels in as many processes as there are processors, and print how far it is.

    RuntimeError with the last line of a compiler that failed.
    """
    places = {store.place_of_level(target, level): level for level in levels}
    keys = {loop_by_name(name).key for name in all_names()}
    missing = [n for n in chosen if any(store.read(place / f"{loop_by_name(n).key}.o") is None for place in places)]
    if missing:
        took = expected_s(missing) * len(levels)
        print(f"compiling {len(missing)} loops of filters, readers and metrics, about {took} s:", end="", flush=True)
        compile_all(places, missing, lambda made, _: print(f" {made}", end="", flush=True))
        print(flush=True)
    for old in target.glob("*/*.o"):
        if old.stem not in keys:
            old.unlink()


def compile_all(places: dict[Path, str], names: list[str], progress: Callable[[int, int], None]) -> None:
    """Compile loops for each place and its level of processor in processes of their own."""
    from concurrent.futures import ThreadPoolExecutor

    parts = max(cores() // len(places), 1)
    jobs = [(place, level, share) for place, level in places.items() for share in _shares(names, parts) if share]
    made = count(1)

    def run(place: Path, level: str, share: list[str]) -> str:
        # The order in which numba goes through sets shows in the code: unfixed, two builds differ in some bytes.
        environment = {**os.environ, "PYTHONHASHSEED": "0"}
        if level:
            environment[LEVEL] = level
            environment.pop("NUMBA_CPU_FEATURES", None)
        command = [sys.executable, "-m", "attlog.core.jit.build", str(place), "--loops", *share]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "errors": "replace"}
        with subprocess.Popen(command, env=environment, **pipes) as process:  # type: ignore[call-overload]
            for line in process.stdout:
                if line.startswith(MADE):
                    progress(next(made), len(names) * len(places))
            said = process.stderr.read()
        return "" if process.returncode == 0 else (said.strip().splitlines() or ["no reason given"])[-1]

    with ThreadPoolExecutor(len(jobs)) as pool:
        failed = [reason for reason in pool.map(run, *zip(*jobs, strict=True)) if reason]
    if failed:
        raise RuntimeError(failed[0])


def _shares(names: list[str], parts: int) -> list[list[str]]:
    """Return what each of several processes compiles: the longest text goes to the one that has least so far."""
    shares: list[list[str]] = [[] for _ in range(parts)]
    load = [0] * parts
    for name in sorted(names, key=lambda n: len(loop_by_name(n).text), reverse=True):
        least = load.index(min(load))
        shares[least].append(name)
        load[least] += len(loop_by_name(name).text)
    return shares


def compile_share(place: Path, names: list[str], mode: int) -> None:
    """Write the objects of some loops for the processor that :data:`LEVEL` names, where they are missing."""
    place.mkdir(parents=True, exist_ok=True)
    for name in names:
        loop = loop_by_name(name)
        path = place / f"{loop.key}.o"
        if store.read(path) is None:
            try:
                store.write(path, object_code(loop), mode)
            except NeedsNumba as error:
                print(f"{loop.what} is compiled at its first use: {error}", file=sys.stderr)
        print(MADE, name, flush=True)


def main() -> None:
    """See the head of this file."""
    import argparse

    options = argparse.ArgumentParser(prog="python -m attlog.core.jit.build", description=__doc__)
    options.add_argument("folder", nargs="?", type=Path, default=store.SHIPPED)
    options.add_argument("--here", action="store_true")
    options.add_argument("--all", action="store_true")
    options.add_argument("--rows", metavar="LIST")
    options.add_argument("--loops", nargs="+", help="of a process of its own")
    asked = options.parse_args()
    if asked.loops:
        compile_share(asked.folder, asked.loops, 0o644 if LEVEL in os.environ else 0o600)
    else:
        chosen = all_names() if asked.all else names_for([asked.rows]) if asked.rows else default_names()
        build(asked.folder, store.levels()[:1] if asked.here else store.portable_levels(), chosen)


if __name__ == "__main__":
    main()
