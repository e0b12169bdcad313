"""A plug-in's filter in a process of its own, so that a fault ends that process alone.

Its code may raise, loop for ever, write beyond its arrays, end its process, take all memory or print. The process that
asked goes on: what came of it is a value, or a PluginError that says what happened. What the file prints, at whatever
moment, goes to standard error; it reads nothing. A process serves one file (or one filter of an installed package) and
many requests, so that a filter is loaded and compiled once (:mod:`attlog.core.workers`).
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from attlog.core.errors import AttlogError, PluginError, PluginTimeout
from attlog.core.limits import FILTER_S, MAX_ERROR_LETTERS, MAX_FILTER_BYTES
from attlog.estimators.interface import Estimator, LogInfo, broken

if TYPE_CHECKING:
    from attlog.core.workers import Died, Worker

T = TypeVar("T")
# Loads a filter into the process that calls it: here.
Load = Callable[[str], Estimator]
# Seconds that a request may take; 0: any time. An environment variable, because processes within processes ask.
TIMEOUT_VARIABLE = "ATTLOG_FILTER_TIMEOUT"


def timeout_s() -> float:
    """Return the time limit in s of one run of a filter from a file; 0: none."""
    try:
        return max(float(os.environ.get(TIMEOUT_VARIABLE, FILTER_S)), 0.0)
    except ValueError:
        return FILTER_S


def from_file(path: Path, load: Load) -> Estimator:
    """Load the estimator of a Python file in another process. PluginError if it cannot be loaded.

    ``load`` loads it there.
    """
    found = path.stat()
    return _described(load, str(path), os.path.abspath(path), (found.st_mtime_ns, found.st_size))


def from_package(name: str, state: str, load: Load) -> Estimator:
    """Load the filter ``name`` of an installed package in another process; ``state`` is its module and version."""
    return _described(load, name, "", (state,))


@functools.lru_cache(maxsize=8)
def _described(load: Load, name: str, place: str, state: tuple[int | str, ...]) -> Estimator:
    """Load a filter once for every state of its file: metrics ask for it again by its name."""
    process = IsolatedFilter(name, load)
    found = process.call(_description)
    return replace(
        found,
        start=None if found.start is None else RemoteFunction("start"),
        step=None if found.step is None else RemoteFunction("step"),
        run=None if found.run is None else RemoteFunction("run"),
        from_log=None if found.from_log is None else functools.partial(_values_from_log, process),
        process=process,
    )


class IsolatedFilter:
    """The process of one filter; started when it is first asked, and again after it died."""

    def __init__(self, name: str, load: Load) -> None:
        self.name, self._load = name, load
        self._worker: Worker | None = None
        self._lock = threading.RLock()
        self._too_long = ""

    def call(self, function: Callable[..., T], *arguments: Any, also_s: float = 0.0, **options: Any) -> T:
        """``function(estimator, *arguments, **options)`` there. Functions, arguments and results must pickle.

        PluginError says what the filter did: its own exceptions with file and line, or how its process ended;
        PluginTimeout where it took longer than :func:`limit_s` (and ``also_s`` for what is not its own work), and from
        then on without trying again.
        """
        from attlog.core.workers import Died, TooLong, Worker

        with self._lock:
            if self._too_long:
                raise PluginTimeout(self._too_long)
            if self._worker is None or not self._worker.alive:
                self._worker = Worker.start(max_bytes=MAX_FILTER_BYTES)
            limit = timeout_s()
            limit += also_s if limit else 0.0
            try:
                found: T = self._worker.call(
                    _called, self._load, self.name, function, arguments, options, seconds=limit
                )
            except TooLong as error:
                self._too_long = f"{self.name}: {error}; ATTLOG_FILTER_TIMEOUT allows more, 0 no end"
                raise PluginTimeout(self._too_long) from None
            except Died as died:
                raise PluginError(f"{self.name}: {_words(died)}") from None
            except AttlogError:
                raise
            except Exception as error:
                raise PluginError(f"{self.name}: its result cannot be handed on ({error})") from error
        return found

    def end(self) -> None:
        """End the process with what the filter started; another is begun when it is asked again."""
        if self._worker is not None:
            self._worker.end()


class RemoteFunction:
    """A placeholder for a filter's function that runs in another process."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __call__(self, *_: Any) -> Any:
        raise TypeError(f"{self._name} of a filter that is not ours runs in its process, by attlog.estimators.estimate")


def _values_from_log(process: IsolatedFilter, params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    return process.call(_from_log, dict(params), info)


def _words(died: Died) -> str:
    """Return how a filter's process ended that gave no answer."""
    ended = died.exit
    if ended.signal == "SIGALRM":
        return "took too long and was ended"
    if ended.crashed:
        return f"its process {ended}: look for indices beyond an array and endless recursion"
    return f"its process {ended}" if str(died).startswith("the process") else str(died)


def _called(
    load: Load, name: str, function: Callable[..., T], arguments: tuple[Any, ...], options: dict[str, Any]
) -> T:
    """Call the function with the filter, which is loaded first; runs in the filter's process."""
    try:
        return function(_loaded(load, name), *arguments, **options)
    except AttlogError as error:
        if len(str(error)) <= 2 * MAX_ERROR_LETTERS:
            raise
        raise broken(name, error) from None
    except BaseException as error:
        raise broken(name, error) from None


@functools.cache
def _loaded(load: Load, name: str) -> Estimator:
    _limit_memory()
    return load(name)


def _from_log(estimator: Estimator, params: dict[str, float], info: LogInfo) -> dict[str, float | str]:
    assert estimator.from_log is not None
    return dict(estimator.from_log(MappingProxyType(params), info))


def _description(estimator: Estimator) -> Estimator:
    """Return an estimator that pickles: its functions become placeholders."""
    return replace(
        estimator,
        presets={name: dict(values) for name, values in estimator.presets.items()},
        slices=dict(estimator.slices),
        start=estimator.start and _nothing,
        step=estimator.step and _nothing,
        run=estimator.run and _nothing,
        from_log=estimator.from_log and _nothing,
    )


def _nothing() -> None:
    """Stands for a function that is somewhere else."""


def _limit_memory() -> None:
    """Let an allocation beyond the limit fail in the file's own line; what is mapped by now does not count."""
    try:
        import resource
    except ImportError:
        return
    with suppress(OSError, ValueError):
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = held + MAX_FILTER_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard < 0 else min(wanted, hard), hard))
