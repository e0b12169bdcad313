"""Which estimators exist: built in, installed by other packages, or in a file of the user.

An estimator's module holds a docstring (its first line is the title, the rest the
equations) and these names:

======== ===========================================================================
SOURCE   paper or package with equation numbers
EQUATION where several files are one equation: its source, the same in all of them (default empty)
NEEDS    what it cannot run without, of ``{"gyro", "acc", "mag", "gnss"}``
USES     what it takes when there (default empty), of these and the aids ``{"gnss", "baro",
         "airspeed", "at_rest"}``, which are described in :mod:`attlog.estimators.aids`
STATE    sizes by name in the order of the state array, ``{"q": 4, "bias": 3, "_P": 9}``;
         names that begin with ``_`` come last and are not kept as output
PARAMETERS, PRESETS, HOLD_MAG, CAUSAL   see :class:`attlog.estimators.interface.Estimator`
start, step   or  run                   the functions
from_log                                optional, see :class:`attlog.estimators.interface.LogFacts`
======== ===========================================================================
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from attlog.core.errors import AttlogError, PluginError, UsageError, missing_file, suggestion
from attlog.estimators import plugins
from attlog.estimators.interface import (
    AIDS,
    COMMON,
    DECLINATION,
    INIT,
    NEEDED,
    SENSORS,
    Estimator,
    Parameter,
    VectorsAt,
    broken,
    choice,
)

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


# An attitude that somebody computed elsewhere, as an estimator's name: ``estimate.csv[:frame=enu-flu,offset=1.5]``.
#
# Such a name has parameters like any other, but cannot be run on samples: its file is read beside the log it
# belongs to (:mod:`attlog.external.attitude`).

RECORDED_SUFFIX = ".csv"
FRAMES = ("auto", "ned-frd", "enu-flu", "ned-flu", "enu-frd", "frd-ned", "flu-enu")
CLOCK = "added to its times to be on the log's clock; 0: found among the clocks of the log"
DELAY = "known delay of its sensors, subtracted from its lag instead of the logged IMU's"
AXES = "earth-body axes of its rotation, body-earth of its inverse; auto: as gyro and gravity agree"
RECORDED_PARAMETERS = (
    Parameter("offset", 0.0, "s", -1e10, 1e10, CLOCK, "the user"),
    Parameter("delay", 0.0, "ms", -1000, 1000, DELAY, "the user"),
    choice("frame", FRAMES, AXES, "the user"),
    choice(
        "angles", ("auto", "deg", "rad"), "unit of Euler angles; auto: by the column's name or the gyro", "the user"
    ),
    choice("north", ("yes", "no"), "no: its heading has no north, its offset is taken out", "the user"),
)


def is_recorded(name: str) -> bool:
    """Return whether a name is that of a file with an attitude."""
    return name.lower().endswith(RECORDED_SUFFIX)


def recorded_estimator(path: Path) -> Estimator:
    """Return a file with an attitude as an estimator that cannot run on samples. UsageError without the file."""
    if not os.path.isfile(path):
        raise UsageError(f"{path}: {missing_file(str(path))}")

    def run(*_: Any) -> NoReturn:
        raise UsageError(f"{path}: holds an attitude that was computed elsewhere; it cannot be run on samples")

    nothing: frozenset[str] = frozenset()
    title = f"Attitude computed elsewhere, read from {path.name}"
    return Estimator(path.stem, title, "", "", nothing, nothing, RECORDED_PARAMETERS, {}, run=run, origin=str(path))


# Module names under ``attlog.estimators.filters``, in the order in which people see them.
BUILT_IN = (
    "gyro",
    "accel_mag",
    "complementary",
    "variable_integral",
    "mahony_passive",
    "mahony_dcm",
    "mahony",
    "mahony_adaptive",
    "madgwick",
    "ekf12",
    "mekf",
    "px4_q",
    "ap_dcm",
    "gsf",
    "vqf",
    "fusion",
    "eskf",
    "smoother",
)

# Filters that share a module with the one they are named after.
MAHONY_FAMILY = dict.fromkeys(
    ("complementary", "variable_integral", "mahony_passive", "mahony_dcm", "mahony_adaptive"), "mahony"
)

# Filters of the firmwares, run again on what they were given on board; they need the flight, not only its samples.
FLOWN = ("px4_ekf2", "ap_ekf3")
# ArduPilot's EKF2, by this package's name of it, is refused.
AP_EKF2 = "ap_ekf2"
AP_EKF2_REFUSAL = "ArduPilot's EKF2 is not run again: on real logs it stayed 0.9° of tilt and 2.5° of heading apart"

_NAME = re.compile(r"[\w.-]+")
# Entry points of this group name modules of other packages: ``my_filter = "my_package.my_filter"``.
GROUP = "attlog.estimators"


def names() -> tuple[str, ...]:
    """Return the names of all built-in and installed estimators; none is imported."""
    return BUILT_IN + tuple(n for n in sorted(_entry_points()) if n not in BUILT_IN)


def get(name: str) -> Estimator:
    """Return the estimator of that name, or of the file ``name`` (``.py``, or ``.csv`` for an attitude).

    Code that is not attlog's runs in a process of its own (:mod:`attlog.estimators.plugins`), its import included.

    UsageError for an unknown name or a file that cannot be read; PluginError with file and line for a broken plug-in.
    """
    if name.endswith(".py"):
        _check_readable(Path(name))
        return plugins.from_file(Path(name), load_here)
    if is_recorded(name):
        return recorded_estimator(Path(name))
    if name in BUILT_IN + FLOWN:
        return _built_in(name)
    point = _entry_point(name)
    return plugins.from_package(name, f"{point.value} {_version(point)}", load_here)


@functools.cache
def _built_in(name: str) -> Estimator:
    module = importlib.import_module(f"attlog.estimators.filters.{MAHONY_FAMILY.get(name, name)}")
    return from_module(getattr(module, "FAMILY", {name: module})[name], name)


def load_here(name: str) -> Estimator:
    """Load a filter that is not attlog's into this process. Errors as of :func:`get`."""
    if name.endswith(".py"):
        return from_file(Path(name))
    point = _entry_point(name)
    try:
        module = importlib.import_module(point.value.partition(":")[0])
    except (Exception, SystemExit) as error:
        raise broken(f"estimator {name} of package {point.dist.name if point.dist else point.value}", error) from error
    return from_module(module, name, origin=point.value)


def from_file(path: Path) -> Estimator:
    """Load the estimator that a Python file defines, named like the file, in this process.

    One whose name is taken by a built-in or installed estimator keeps its suffix: ``mahony.py``.
    UsageError for a file that cannot be read, PluginError with file and line if it cannot be loaded.
    """
    _check_readable(path)
    spec = importlib.util.spec_from_file_location(f"attlog_plugin_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise PluginError(f"{path}: cannot be loaded as a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise broken(str(path), error) from error
    return from_module(module, path.name if path.stem in names() else path.stem, origin=str(path))


def from_module(module: Any, name: str, origin: str = "attlog") -> Estimator:
    """Return the estimator that a module or a class describes. PluginError says which name is missing or wrong."""
    where = origin if origin != "attlog" else name
    title, _, text = inspect.cleandoc(module.__doc__ or name).partition("\n")
    state = dict(getattr(module, "STATE", {"q": 4}))
    needs = frozenset(getattr(module, "NEEDS", {"gyro", "acc"}))
    uses = frozenset(getattr(module, "USES", ())) | needs
    own = tuple(getattr(module, "PARAMETERS", ()))
    start, step, run = (getattr(module, n, None) for n in ("start", "step", "run"))
    presets, from_log = getattr(module, "PRESETS", {}), getattr(module, "from_log", None)
    vectors_at: VectorsAt = getattr(module, "VECTORS_AT", "start")
    if vectors_at not in ("start", "end"):
        raise PluginError(f"{where}: VECTORS_AT must be start or end, not {vectors_at!r}")
    if run is None and not (callable(start) and callable(step)):
        raise PluginError(f"{where}: defines neither start and step nor run; see attlog new")
    if not needs <= NEEDED:
        raise PluginError(f"{where}: NEEDS may name gyro, acc, mag and gnss, not {', '.join(sorted(needs - NEEDED))}")
    if not uses <= SENSORS | AIDS:
        known = ", ".join([*sorted(SENSORS), *sorted(AIDS)])
        raise PluginError(f"{where}: USES may name {known}, not {', '.join(sorted(uses - SENSORS - AIDS))}")
    if from_log is not None and not callable(from_log):
        raise PluginError(f"{where}: from_log must be a function of params and info")
    if not all(isinstance(p, Parameter) for p in own):
        raise PluginError(f"{where}: PARAMETERS must hold attlog.estimators.Parameter objects")
    twice = sorted({p.name for k, p in enumerate(own) if p.name in [q.name for q in own[:k]]})
    if twice:  # a step takes them by their place, a command line by their name
        raise PluginError(f"{where}: PARAMETERS names {', '.join(twice)} twice")
    if next(iter(state.items())) != ("q", 4):
        raise PluginError(f'{where}: STATE must begin with "q": 4')
    reserved = {p.name for p in own} & {p.name for p in COMMON}
    if reserved:
        raise PluginError(f"{where}: {', '.join(sorted(reserved))} belongs to the shared loop; take another name")
    common = [INIT] * (run is None) + [DECLINATION] * ("mag" in uses)
    estimator = Estimator(
        name=name,
        title=title.strip(),
        text=text.strip("\n"),
        source=str(getattr(module, "SOURCE", "")),
        needs=needs,
        uses=uses,
        parameters=(*own, *common),
        presets=presets,
        state_size=sum(state.values()),
        slices=_slices(state, where),
        start=start,
        step=step,
        run=run,
        causal=bool(getattr(module, "CAUSAL", True)),
        origin=origin,
        hold_mag=bool(getattr(module, "HOLD_MAG", True)),
        vectors_at=vectors_at,
        from_log=from_log,
        aliases=getattr(module, "ALIASES", {}),
        not_offered=getattr(module, "NOT_OFFERED", {}),
        equation=str(getattr(module, "EQUATION", "")),
        without_gnss=str(getattr(module, "WITHOUT_GNSS", "")) if origin == "attlog" else "",
    )
    _check_arguments(estimator, where)
    _check_tables(estimator, where)
    return estimator


def _slices(state: Mapping[str, int], where: str) -> dict[str, slice]:
    """Return the slice of the state of each public name; private names must come last."""
    slices, begin, private = {}, 0, False
    for name, size in state.items():
        if private and not name.startswith("_"):
            raise PluginError(f"{where}: in STATE, {name} follows a name that begins with _; private parts come last")
        private = private or name.startswith("_")
        if not private and name != "q":
            slices[name] = slice(begin, begin + int(size))
        begin += int(size)
    if "bias" in slices and slices["bias"].stop - slices["bias"].start != 3:
        raise PluginError(f"{where}: STATE bias must have size 3 (rad/s)")
    return slices


def _check_arguments(estimator: Estimator, where: str) -> None:
    """PluginError if a function takes another number of arguments than it will be given."""
    wanted = {
        "start": ("params", "acc", "mag", "q0"),
        "step": ("state", "params", "dt", "gyr", "acc", "mag") + ("aid",) * estimator.aided,
        "run": ("t", "gyr", "acc", "mag", "aids", "params"),
        "from_log": ("params", "info"),
    }
    for name, arguments in wanted.items():
        function = getattr(estimator, name)
        if function is None:
            continue
        try:
            inspect.signature(function).bind(*arguments)
        except TypeError:
            hint = "; aid is there because USES names aids" if name == "step" and estimator.aided else ""
            raise PluginError(f"{where}: {name} must take {', '.join(arguments)}{hint}") from None
        except ValueError:
            continue  # not a Python function: its arguments are unknown


def _check_tables(estimator: Estimator, where: str) -> None:
    """PluginError if a default or a preset breaks the estimator's own rules."""
    try:
        for p in estimator.parameters:
            p.check(p.default, estimator.name)
        for preset in estimator.presets:
            estimator.resolve(preset)
    except AttlogError as error:
        raise PluginError(f"{where}: {error}") from error


def _check_readable(path: Path) -> None:
    """UsageError, with what is the matter, for a path that is no file that can be read."""
    try:
        if stat.S_ISREG(path.stat().st_mode):
            path.open("rb").close()
            return
        why = "a folder" if path.is_dir() else "no regular file"
        raise UsageError(f"{path}: is {why}; name a Python file (attlog new FILE.py writes one)")
    except FileNotFoundError:
        raise UsageError(f"{path}: there is no such estimator file (attlog new FILE.py writes one)") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: this estimator file cannot be read ({reason})") from None


def _entry_point(name: str) -> EntryPoint:
    """Return the entry point of that name. UsageError with a suggestion if there is none."""
    points = _entry_points()
    if name == AP_EKF2 and name not in points:
        raise UsageError(AP_EKF2_REFUSAL)
    if name not in points:
        raise UsageError(f"there is no estimator {name}{suggestion(name, names() + FLOWN)}")
    return points[name]


def _version(point: EntryPoint) -> str:
    """Return the version of a filter's package, empty where its metadata lacks it."""
    try:
        return str(point.dist.version) if point.dist else ""
    except Exception:  # importlib and its stand-in importlib_metadata raise differently
        return ""


def _entry_points() -> dict[str, EntryPoint]:
    """Return the filters of installed packages by name, of two with one name the first on the path.

    A package whose description is damaged has none; it need not have to do with attlog.
    """
    from importlib.metadata import distributions

    found: dict[str, EntryPoint] = {}
    for package in distributions():
        try:
            points = [p for p in package.entry_points if p.group == GROUP and _NAME.fullmatch(p.name)]
        except Exception:  # whatever reading somebody's files may raise
            continue
        for point in points:
            found.setdefault(point.name, point)
    return found
