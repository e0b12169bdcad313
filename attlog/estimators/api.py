"""Running an estimator by its name: ``NAME[@PRESET][:k=v,...]`` and lists of such rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from attlog.core import rotation
from attlog.core.brief import brief
from attlog.core.errors import PluginError, UsageError
from attlog.core.sorting import median
from attlog.estimators import run as loop
from attlog.estimators.aids import Aids
from attlog.estimators.interface import Array, Estimate, Estimator, LogFacts, cut_by_comma
from attlog.estimators.registry import BUILT_IN, get, names
from attlog.estimators.samples import HOLD_PERIODS, Sampling, place, prepare
from attlog.estimators.unit_checks import warn_of_units
from attlog.flight.model import FlightLog

# The rows of ``default``: the papers' filters and modern ones with the gains of docs/estimators.md, and the bare
# gyro as the baseline that wins nothing.
DEFAULT = tuple(
    name for name in ("complementary", "mahony", "madgwick", "ekf12", "vqf", "mekf", "eskf", "gyro") if name in BUILT_IN
)


class PreparedLog(Protocol):
    """Log prepared for filters, as :func:`attlog.prepare` returns it."""

    log: FlightLog


@dataclass(frozen=True, slots=True)
class EstimatorSpec:
    """One line of a comparison: an estimator, its preset and the values set by hand.

    ``name`` is what the table shows, for example ``mahony@xu-0.6`` or ``mahony:kp=0.8``.
    """

    estimator: Estimator
    preset: str | None = None
    params: Mapping[str, float | str] = field(default_factory=dict)
    __repr__ = brief

    @property
    def name(self) -> str:
        text = self.estimator.name + (f"@{self.preset}" if self.preset else "")
        values = ",".join(f"{k}={v:g}" if isinstance(v, float) else f"{k}={v}" for k, v in self.params.items())
        return f"{text}:{values}" if values else text

    def resolved(self, log: LogFacts | None = None) -> dict[str, tuple[float | str, str]]:
        """Every parameter's value and origin (default, log, preset, option)."""
        return self.estimator.resolve(self.preset, self.params, log=log)


def parse(text: str) -> EstimatorSpec:
    """Parse ``NAME[@PRESET][:k=v,...]`` or ``FILE.py[@PRESET][:k=v,...]``.

    UsageError with a suggestion for unknown names, presets, parameters and values.
    """
    head, pairs = _split(text.strip())
    name, _, preset = head.partition("@")
    estimator = get(name)
    params = {}
    for before, pair in pairwise(["", *pairs]):
        key, equals, value = pair.partition("=")
        if not equals:
            raise UsageError(f"{text}: {pair} is not NAME=VALUE{cut_by_comma(before, pair.strip())}")
        parameter = estimator.parameter(key.strip())
        params[parameter.name] = parameter.check(value.strip(), estimator.name)
    row = EstimatorSpec(estimator, preset or None, params)
    row.resolved()
    return row


def select(text: str, *, acc: bool = True, mag: bool = True, gnss: bool = True) -> list[EstimatorSpec]:
    """Parse a comma-separated list of rows; ``default`` and ``all`` mean whole sets.

    ``acc``, ``mag`` and ``gnss`` say which sensors the log has: sets leave out what cannot run
    without them, rows that are named stay. A row that comes twice is kept once.
    UsageError as in :func:`parse`.
    """
    sets: dict[str, tuple[str, ...]] = {"default": DEFAULT}
    if "all" in items(text):
        sets["all"] = names()
    lacking = {sensor for sensor, there in (("acc", acc), ("mag", mag), ("gnss", gnss)) if not there}
    rows: dict[str, EstimatorSpec] = {}
    for item in items(text):
        members = [_member(one) for one in sets[item]] if item in sets else [parse(item)]
        for row in members:
            if item not in sets or not row.estimator.needs & lacking:
                add(rows, row)
    return list(rows.values())


def add(rows: dict[str, Any], row: EstimatorSpec) -> None:
    """Add a row to those by name, once. UsageError where another estimator's row has the name."""
    other = rows.setdefault(row.name, row)
    if isinstance(other, EstimatorSpec) and other.estimator.origin != row.estimator.origin:
        both = " and ".join(one.estimator.origin for one in (other, row))
        raise UsageError(f"{both} are both called {row.name}; rename one of the files")


def _member(name: str) -> EstimatorSpec:
    """Return a row of a set; one that an installed package broke fails only when it is run."""
    try:
        return parse(name)
    except PluginError as error:
        broken = error

    def run(*_: object) -> Estimate:
        raise broken

    nothing: frozenset[str] = frozenset()
    return EstimatorSpec(Estimator(name, str(broken), "", "", nothing, nothing, (), {}, run=run))


def estimate(
    name: str | EstimatorSpec | Estimator,
    t: ArrayLike | FlightLog | PreparedLog | Path,
    gyr: ArrayLike | None = None,
    acc: ArrayLike | None = None,
    mag: ArrayLike | None = None,
    *,
    sampling: Sampling = "interval",
    q0: ArrayLike | None = None,
    declination: float | None = None,
    dt: ArrayLike | None = None,
    every: int = 1,
    aids: Aids | None = None,
    log: LogFacts | None = None,
    check_units: bool = True,
    **params: Any,
) -> Estimate:
    """Estimate the attitude (n, 4) of a log or of raw sensor samples, with bias and counts.

    ``estimate("mahony", log)`` takes a log, its path or a prepared :class:`~attlog.Case` for ``t`` and runs the filter
    as an analysis does, on the log's own IMU, compass, aids and sampling, with its gyro bias at rest subtracted (and
    part of the ``bias`` returned); with the log go ``params`` and the keywords ``q0``, ``declination`` and ``every``.

    ``name``: ``NAME[@PRESET][:k=v,...]``, an EstimatorSpec or an Estimator. ``t`` (n,) s; ``gyr`` (n, 3)
    rad/s; ``acc`` (n, 3) m/s^2 specific force; ``mag`` (n, 3) any unit, NaN rows where there
    is no new sample (:func:`place` puts slow samples there); body FRD. ``sampling``:
    ``interval`` where a sample is the mean over the time since the one before (PX4),
    ``instant`` where it is the value at its time (ArduPilot). ``q0`` start attitude, else
    from the sensors. ``declination`` deg, positive east. ``dt`` (n,) s: each sample's own
    integration time where known. ``every`` keeps each n-th output. ``aids``: GNSS, barometer,
    airspeed and times at rest for estimators that use them; its ``mag`` replaces a missing ``mag``.
    ``log``: parameters and facts of a log; a preset and ``params`` override it. ``check_units``: whether samples that
    look as if they were in other units are warned of, which takes some ms.

    A filter that flew (``px4_ekf2``, ``ap_ekf3``) takes a log, and a mapping of the firmware's parameters as
    ``params``: ``estimate("ap_ekf3", log, params={"EK3_MAG_M_NSE": 0.1})``.

    The result is at the input's own good samples; what was left out is counted in
    ``skipped``. North is magnetic unless ``declination`` is given, and without ``mag`` where the first heading
    pointed. Equations and sources of each: ``attlog estimators NAME``. UsageError for wrong shapes, names or values,
    or a missing sensor; PluginError and PluginTimeout of estimators that are not attlog's. UnitWarning where samples
    look as if they were in deg/s, g, us or axes of another convention.
    """
    row = parse(name) if isinstance(name, str) else name if isinstance(name, EstimatorSpec) else EstimatorSpec(name)
    estimator = row.estimator
    if gyr is None and _is_log(t):
        brought = {"acc": acc, "mag": mag, "dt": dt, "aids": aids, "log": log}
        foreign = [key for key, value in brought.items() if value is not None]
        foreign += ["sampling"] * (sampling != "interval")
        if foreign:
            raise UsageError(f"{', '.join(foreign)}: a log brings its own; leave it out or give t, gyr, acc as arrays")
        from attlog.pipeline.replay import estimate_log  # needs the whole flight

        asked = {**row.params, **dict(params.pop("params", {})), **params}
        source: Any = t
        return estimate_log(replace(row, params=asked), source, q0=q0, declination=declination, every=every)
    if gyr is None:
        raise UsageError(f"{estimator.name} needs a log or gyro samples: estimate({estimator.name!r}, t, gyr, acc)")
    times: Any = t
    if check_units and log is None:  # the samples of a log are in the units of its flight
        warn_of_units(times, gyr, acc)
    if estimator.process is not None:
        facts = None if log is None else replace(log, params=dict(log.params), given=dict(log.given))
        return estimator.process.call(
            _there,
            row.preset,
            {**row.params, **params},
            (times, gyr, acc, mag),
            sampling=sampling,
            q0=q0,
            declination=declination,
            dt=dt,
            every=every,
            aids=aids,
            log=facts,
        )
    if mag is None and isinstance(aids, Aids) and aids.mag is not None and "mag" in estimator.uses:
        mag = place(times, aids.mag.t, aids.mag.x)
    fixes = aids.velocity if isinstance(aids, Aids) else None
    for sensor, data in (("acc", acc), ("mag", mag), ("gnss", fixes)):
        if sensor in estimator.needs and data is None:
            raise UsageError(f"{estimator.name} needs {sensor}, which was not given")
    if every < 1 or int(every) != every:
        raise UsageError(f"every={every} must be a whole number from 1")
    given = {**row.params, **params}
    if declination is not None and any(p.name == "declination" for p in estimator.parameters):
        given["declination"] = declination
    if aids is not None and not isinstance(aids, Aids):
        raise UsageError(f"aids must be attlog.estimators.Aids, not {type(aids).__name__}")
    values = {k: v for k, (v, _) in estimator.resolve(row.preset, given, log=log).items()}
    if estimator.without_gnss and (aids is None or (aids.velocity is None and aids.position is None)):
        if "declination" in values:
            declination = float(values["declination"])
        other = {"sampling": sampling, "q0": q0, "declination": declination, "dt": dt, "every": every, "aids": aids}
        other["check_units"] = False
        found = estimate(estimator.without_gnss, times, gyr, acc, mag, **other)  # type: ignore[arg-type]
        heard = [*["mag"] * (mag is not None), *["airspeed"] * (aids is not None and aids.airspeed is not None)]
        quality: dict[str, float | str] = {"aided_by": " ".join(heard) or "gravity", "model": estimator.without_gnss}
        return replace(found, quality=found.quality | quality)
    ours = estimator.origin == "attlog"
    lead = not ours or (estimator.run is None and estimator.vectors_at == "start")
    samples = prepare(times, gyr, acc, mag, dt=dt, sampling=sampling, hold_mag=estimator.hold_mag, lead=lead, ours=ours)
    samples.once = ours  # others may have to run again, to say where they failed
    del t, times, gyr, acc, mag, data, fixes, dt  # what was made for this call alone goes before the filter runs
    if estimator.run is not None:
        aids = replace(aids or Aids(), sampling=sampling)
    return loop.with_line(estimator, lambda: loop.run(estimator, samples, values, q0, int(every), aids))


def _is_log(given: object) -> bool:
    """Return whether ``t`` is a log, its path or a prepared log rather than times."""
    return isinstance(given, str | Path | FlightLog) or isinstance(getattr(given, "log", None), FlightLog)


def _there(
    estimator: Estimator,
    preset: str | None,
    params: Mapping[str, float | str],
    data: tuple[ArrayLike, ArrayLike, ArrayLike | None, ArrayLike | None],
    **options: Any,
) -> Estimate:
    """:func:`estimate` in the process of a file."""
    return estimate(EstimatorSpec(estimator, preset, params), *data, check_units=False, **options)


def _split(text: str) -> tuple[str, list[str]]:
    """``NAME@PRESET`` and the ``k=v`` pairs; a colon of a file name (``C:\\x.py``) stays in the name."""
    begin = text.find(".py") + 3 if ".py" in text else 0
    head, _, tail = text[begin:].partition(":")
    return text[:begin] + head, [p for p in tail.split(",") if p.strip()]


def items(text: str) -> list[str]:
    """Split a list of rows; a bare ``k=v`` belongs to the row before it, UsageError without one."""
    found: list[str] = []
    for item in (p.strip() for p in text.split(",")):
        if found and "=" in item and ":" not in item.partition("=")[0]:
            found[-1] += "," + item
        elif found and (hint := cut_by_comma(found[-1], item)):
            raise UsageError(f"{found[-1]},{item}: there is no estimator {item}{hint}")
        elif item:
            found.append(item)
    if not found:
        raise UsageError("no estimator named; give default, all or NAME[@PRESET][:k=v,...]")
    return found


# A slow magnetometer between its samples, for estimators that take whole segments.


def propagated(t: Array, gyr: Array, mag: Array) -> Array:
    """Propagate the last field with the gyro to every sample (n, 3) for up to 1.5 of its periods, else 0.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``mag`` (n, 3) with NaN rows where there is no new
    sample, as ``run`` gets them. The shared loop does the same for steps.
    """
    new = np.flatnonzero(np.isfinite(mag).all(axis=1))
    field = np.zeros_like(mag)
    if len(new) == 0:
        return field
    q = estimate("gyro", t, gyr, q0=[1.0, 0.0, 0.0, 0.0], check_units=False).q
    last = np.searchsorted(new, np.arange(len(t)), side="right") - 1
    source = new[np.maximum(last, 0)]
    period = float(median(np.diff(t[new]))) if len(new) > 1 else 0.0
    use = (last >= 0) & (t - t[source] <= HOLD_PERIODS * period)
    field[use] = rotation.rotate_inverse(q[use], rotation.rotate(q[source[use]], mag[source[use]]))
    return field
