"""Running estimators over a Case: each as a row of attitudes, aligned, and as a line of the result's table."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np

from attlog import estimators, reference
from attlog.core.errors import AttlogError, PluginError, UsageError, guarded
from attlog.core.spans import Span
from attlog.estimators.interface import Estimate
from attlog.estimators.registry import BUILT_IN, FLOWN
from attlog.flight.model import FlightLog, Imu, Mag
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Case, per_case
from attlog.pipeline import inputs
from attlog.reference import alignment
from attlog.reference.model import Track
from attlog.result import EstimatorRow, ParameterValue
from attlog.segments import model
from attlog.segments.model import Segments

STAGES = logging.getLogger("attlog.stages")
"""Tells which filter is being run; who wants to know adds a handler."""

KNOWN_RAD = np.deg2rad(15.0)
"""Both firmwares use a heading by GNSS motion below this sigma (EKFGSF_yaw_err_max, GSF_YAW_ACCURACY_THRESHOLD_DEG)."""


class Runnable(Protocol):
    """What stands for a filter's name where more is to be said: what comes before it, or whose attitude it is."""

    @property
    def name(self) -> str:
        """What the row is called."""

    @property
    def row(self) -> estimators.EstimatorSpec:
        """The filter that runs."""

    def run(self, case: Case, imu: Imu, suffix: str) -> tuple[Track, EstimatorRow]:
        """The row of one unit, and its line of the table; ``suffix`` follows its name. AttlogError if it fails."""


Chosen: TypeAlias = estimators.EstimatorSpec | Runnable | PluginError
"""What is to be run, or why it cannot be."""


def run_rows(case: Case, specs: Sequence[str]) -> list[Track]:
    """The aligned attitudes of the named estimators only; the first failure is raised."""
    rows = []
    for suffix, imu in case.imus.items():
        for spec in chosen(specs, case.log).values():
            if isinstance(spec, PluginError):
                raise spec
            rows.append(_run(case, imu, spec, suffix)[0])
    return rows


def smoother(
    log: FlightLog, segments: Segments, options: reference.ReferenceOptions, *, compass: bool = True
) -> Estimate:
    """What the whole-run smoother finds in the IMU that flew, from both sides of each moment.

    It knows the lag of the IMU's filters, gives the attitude of each stamp itself and does not share that lag. Each
    segment between gaps, impacts and losses of control stands for itself; those that fail their own checks are left
    out. UsageError where that leaves too little, for a log too long, or without accelerometer. Not ``compass``: as if
    the log held none.
    """
    imu = log.replay_imu
    asked = options.reference != "auto"
    spans = reference.smoothable(log, segments)
    why_not = "" if asked and spans else reference.reason_not_smoothed(log, segments)
    if why_not or imu is None:
        raise UsageError(why_not)
    STAGES.info("running %s", reference.SMOOTHER)
    north, _ = alignment.declination_step(log, options.declination)
    field = alignment.earth_field(log)
    if field is not None and north is not None:
        field = replace(field, declination_deg=north)
    aids, facts = inputs.aids_of(log, segments, imu, field), inputs.facts_of(log, segments, imu, north)
    t = imu.gyro.t_best
    mag = None if log.mag is None or not compass else log.mags[log.mag]

    def smoothed(span: Span) -> Estimate:
        use = np.flatnonzero((t >= span[0]) & (t <= span[1]))
        return estimators.estimate(
            reference.SMOOTHER,
            t[use],
            imu.gyro.x[use],
            imu.acc.x[use],
            estimators.place(t[use], mag.field.t_best, mag.field.x) if mag is not None else None,
            sampling=imu.gyro.sampling,
            dt=None if imu.dt is None else imu.dt[use],
            aids=aids,
            log=facts,
        )

    return reference.join_segments([smoothed(span) for span in spans], whatever=asked)


def replays(
    case: Case, specs: Mapping[str, Chosen], failed: dict[str, AttlogError] | None = None
) -> Iterator[tuple[Track | None, EstimatorRow]]:
    """Each chosen estimator as a row; one that fails is a table row with status ``failed``.

    ``failed`` takes the errors by the rows' names.
    """
    for suffix, imu in case.imus.items():
        for name, spec in specs.items():
            kind = "rerun" if is_rerun(spec) else "replay"
            if kind == "rerun" and imu is not case.log.replay_imu:
                continue  # it flew on one unit
            try:
                if isinstance(spec, PluginError):
                    raise spec
                yield guarded(
                    name, partial(_run, case, imu, spec, suffix, whole=False), partial(_bug, name + suffix, kind)
                )
            except AttlogError as error:
                if failed is not None:
                    failed[name + suffix] = error
                yield None, _failed(name + suffix, kind, error)


def again(case: Case, specs: Mapping[str, Chosen], name: str) -> Track:
    """A row of :func:`replays` once more, by its name, now that all of it is wanted. AttlogError as there."""
    imu, spec, suffix = next(
        (imu, spec, suffix) for suffix, imu in case.imus.items() for n, spec in specs.items() if n + suffix == name
    )
    if isinstance(spec, PluginError):
        raise spec
    return _run(case, imu, spec, suffix)[0]


def _bug(name: str, kind: str, sentence: str) -> tuple[None, EstimatorRow]:
    """The row of an estimator whose replay ended in a bug."""
    return None, _failed(name, kind, AttlogError(sentence))


def chosen(specs: Sequence[str | Runnable], log: FlightLog) -> dict[str, Chosen]:
    """Name -> row to run, each once; a plug-in that cannot be loaded is its error. UsageError for unknown names.

    The sets ``default`` and ``all`` begin with the filter that flew.
    """
    found: dict[str, Chosen] = {}
    if flown := rerun_by_default(specs, log):
        estimators.add(found, estimators.parse(flown))
    for item in specs:
        if not isinstance(item, str):
            found.setdefault(item.name, item)
            continue
        try:
            for row in estimators.select(item, mag=log.mag is not None, gnss=inputs.receiver_of(log) is not None):
                estimators.add(found, row)
        except PluginError as error:
            found.setdefault(Path(item).stem, error)
    return found


def rerun_by_default(specs: Sequence[str | Runnable], log: FlightLog) -> str:
    """Return the filter that flew where a set asks for it; empty where it is named itself or attlog has none."""
    from attlog.pipeline.onboard_rerun import flown_filter  # most logs have one, `attlog info` needs none

    named = {
        item for specification in specs if isinstance(specification, str) for item in estimators.items(specification)
    }
    flown = flown_filter(log) if named & {"default", "all"} else ""
    return "" if flown in named else flown


@per_case
def facts(case: Case, suffix: str) -> estimators.LogFacts:
    """What the log tells about parameters of filters that replay this unit."""
    return inputs.facts_of(case.log, case.segments, case.imus[suffix], case.reference.alignment.declination_deg)


@per_case
def aids_of(case: Case, suffix: str) -> estimators.Aids:
    """What the log holds beside inertial and magnetic samples, for filters that replay this unit."""
    return inputs.aids_of(case.log, case.segments, case.imus[suffix], alignment.earth_field(case.log))


def _run(
    case: Case, imu: Imu, spec: estimators.EstimatorSpec | Runnable, suffix: str, whole: bool = True
) -> tuple[Track, EstimatorRow]:
    """One estimator over one IMU as the log has it, or as the runnable wants it; ``whole`` as :func:`replayed`."""
    STAGES.info("running %s", spec.name)
    if not isinstance(spec, estimators.EstimatorSpec):
        return spec.run(case, imu, suffix)
    if is_recorded(spec):
        return recorded_row(case, imu, spec, spec.name + suffix)
    if is_rerun(spec):
        from attlog.pipeline.onboard_rerun import rerun_row  # no other row needs it

        return rerun_row(case, imu, spec, spec.name + suffix)
    mag = None if case.log.mag is None else case.log.mags[case.log.mag]
    told, aids = facts(case, suffix), aids_of(case, suffix)
    return replayed(case, imu, mag, spec, told, aids, spec.name + suffix, whole)


def is_rerun(spec: Chosen) -> bool:
    """Whether a row is a re-run of the filter that flew."""
    return isinstance(spec, estimators.EstimatorSpec) and spec.estimator.name in FLOWN


def is_recorded(spec: estimators.EstimatorSpec) -> bool:
    """Whether a row is an attitude that was computed elsewhere."""
    return estimators.is_recorded(spec.estimator.origin)


def recorded_row(case: Case, imu: Imu, spec: estimators.EstimatorSpec, name: str) -> tuple[Track, EstimatorRow]:
    """Return an external attitude as a row. Errors as of :func:`attlog.external.attitude.read_attitude`."""
    values = spec.resolved()
    asked = {k: v for k, (v, _) in values.items()}
    from attlog.external import attitude  # no other row needs it

    estimate = attitude.read_attitude(Path(spec.estimator.origin), case.log, imu, asked)
    row = reference.replayed(
        case.log,
        case.segments,
        case.reference,
        estimate,
        name=name,
        estimator=spec.estimator.origin,
        parameters=asked,
        uses_mag=asked["north"] == "yes",
    )
    row.imu, row.ns_per_update, row.quality = imu, None, dict(estimate.quality)
    known = {p.name: p for p in spec.estimator.parameters}
    parameters = {k: ParameterValue(v, origin, known[k].unit, known[k].meaning) for k, (v, origin) in values.items()}
    return row, table_row(row, spec.estimator.name, None, parameters, spec.estimator.title)


def replayed(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    spec: estimators.EstimatorSpec,
    told: estimators.LogFacts,
    aids: estimators.Aids,
    name: str,
    whole: bool = True,
) -> tuple[Track, EstimatorRow]:
    """Run one estimator over the samples of a unit and a magnetometer, and align what comes out.

    Not ``whole``: without what it tells beside attitude and bias, which no metric looks at, and which in a long log is
    as large as the attitude.
    """
    log, ref = case.log, case.reference
    uses_mag = mag is not None and "mag" in spec.estimator.uses
    resolved = spec.resolved(told)
    t = imu.gyro.t_best if ref.alignment.clock == "sample" else imu.gyro.t
    estimate = estimators.estimate(
        spec,
        t,
        case.gyro_of(imu),
        imu.acc.x,
        estimators.place(t, mag.field.t_best, mag.field.x) if mag is not None and uses_mag else None,
        sampling=imu.gyro.sampling,
        dt=imu.dt,
        aids=_with_field(aids, spec.estimator, mag),
        log=told,
    )
    north_by_gnss = "gnss" in spec.estimator.needs and wait_for_motion(estimate)
    if np.array_equal(estimate.t, t):
        estimate.t = t  # one array for all rows: in long logs copies add up
    if not whole:
        estimate.aux = {}
    row = reference.replayed(
        log,
        case.segments,
        ref,
        estimate,
        name=name,
        estimator=spec.estimator.origin if spec.estimator.origin.endswith(".py") else spec.estimator.name,
        parameters={k: v for k, (v, _) in resolved.items()},
        uses_mag=uses_mag,
        north_by_gnss=north_by_gnss,
    )
    row.imu = imu
    row.equation = spec.estimator.equation
    row.quality, row.aux = dict(estimate.quality), dict(estimate.aux)
    _add_common_bias(row, case.bias_of(imu))
    known = {p.name: p for p in spec.estimator.parameters}
    parameters = {k: ParameterValue(v, origin, known[k].unit, known[k].meaning) for k, (v, origin) in resolved.items()}
    return row, table_row(row, spec.estimator.name, spec.preset, parameters, spec.estimator.title)


def wait_for_motion(estimate: Estimate) -> bool:
    """Mark the time until GNSS motion told a heading, in each segment. Whether the filter says how sure it is of it.

    UsageError where no motion ever told one: such a row would leave no time in which all rows can be compared.
    """
    sigma = estimate.aux.get("sigma_heading")
    if sigma is None or estimate.segment is None or not len(sigma):
        return False
    if not np.any(sigma < KNOWN_RAD):
        least = np.rad2deg(np.min(sigma))
        raise UsageError(f"no GNSS motion told the heading: its sigma is {least:.0f} deg at the least, 15 are needed")
    for part in model.segment_slices(np.ones(len(sigma), bool), estimate.segment):
        known = np.append(np.flatnonzero(sigma[part] < KNOWN_RAD), part.stop - part.start)[0]
        end = np.append(estimate.t[part], np.nextafter(estimate.t[part.stop - 1], np.inf))[known]
        estimate.no_heading.append((float(estimate.t[part.start]), float(end)))
    return True


def _with_field(aids: estimators.Aids, estimator: estimators.Estimator, mag: Mag | None) -> estimators.Aids:
    """The aids with the magnetometer at its own times, which whole runs of plug-ins are told."""
    if mag is None or estimator.run is None or estimator.origin == "attlog" or "mag" not in estimator.uses:
        return aids
    return replace(aids, mag=inputs.field_of(mag))


def _add_common_bias(row: Track, taken: CommonBias) -> None:
    """The row's bias as all that it takes off the logged gyro: what was subtracted for everybody, and its own."""
    row.estimates_bias = row.bias is not None and bool(np.any(row.bias))
    if row.bias is not None and not row.estimates_bias:
        row.bias = taken.at(row.t)  # a constant takes no memory
    elif row.bias is not None and taken.taken != "none":
        row.bias = row.bias + taken.at(row.t)


def table_row(
    row: Track,
    estimator: str = "",
    preset: str | None = None,
    parameters: dict[str, ParameterValue] | None = None,
    title: str = "",
) -> EstimatorRow:
    """A row as the result lists it, its answers still empty."""
    return EstimatorRow(
        row.name,
        row.kind,
        estimator,
        row.status,
        row.reason,
        title,
        preset,
        parameters or {},
        row.is_reference,
        row.causal,
        row.uses_mag,
        row.north_by_gnss,
        row.start,
        row.skipped,
        row.quality,
        row.reproduction,
        row.ns_per_update,
    )


def _failed(name: str, kind: str, error: AttlogError) -> EstimatorRow:
    return EstimatorRow(name, kind, name, "failed", str(error))


def batch(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    spec: estimators.EstimatorSpec,
    settings: Sequence[Mapping[str, float | str]],
    told: estimators.LogFacts,
    aids: estimators.Aids,
) -> list[Track]:
    """The rows of one filter with many parameter sets, run side by side over the samples of a unit.

    Each as :func:`replayed` gives it alone; ``settings`` are laid over the parameters of ``spec``. UsageError for
    values out of range or a sensor that the filter needs and the log has not, PluginError of a plug-in.
    """
    from attlog.estimators.batch import estimate_batch

    log, ref, estimator = case.log, case.reference, spec.estimator
    if "mag" in estimator.needs and mag is None:
        raise UsageError(f"{estimator.name} needs a magnetometer; the log holds none")
    if "gnss" in estimator.needs and aids.velocity is None:
        raise UsageError(f"{estimator.name} needs gnss, which was not given")
    uses_mag = mag is not None and "mag" in estimator.uses
    STAGES.info("running %s with %d parameter sets", spec.name, len(settings))
    t, taken = imu.gyro.t_best if ref.alignment.clock == "sample" else imu.gyro.t, case.bias_of(imu)
    chosen = [estimators.EstimatorSpec(estimator, spec.preset, {**spec.params, **setting}) for setting in settings]
    found = estimate_batch(
        estimator,
        [row.params for row in chosen],
        t,
        case.gyro_of(imu),
        imu.acc.x,
        estimators.place(t, mag.field.t_best, mag.field.x) if mag is not None and uses_mag else None,
        preset=spec.preset,
        sampling=imu.gyro.sampling,
        dt=imu.dt,
        aids=_with_field(aids, estimator, mag),
        log=told,
    )
    rows = []
    for one, estimate in zip(chosen, found, strict=True):
        row = reference.replayed(
            log,
            case.segments,
            ref,
            estimate,
            name=one.name,
            estimator=estimator.origin if estimator.origin.endswith(".py") else estimator.name,
            parameters={k: v for k, (v, _) in one.resolved(told).items()},
            uses_mag=uses_mag,
            north_by_gnss="gnss" in estimator.needs and wait_for_motion(estimate),
        )
        row.imu = imu
        row.quality = dict(estimate.quality)
        _add_common_bias(row, taken)
        rows.append(row)
    return rows


# Compiled loops of filters, loaded before a process forks others that then have them.


def preload(specs: Sequence[str]) -> None:
    """Load the compiled loops of built-in filters into this process, which then forks others that have them.

    Others are left out: their code runs where a log is analysed. What fails here fails there, and is told.
    """
    t = np.arange(100) * 0.004
    rest = (np.zeros((t.size, 3)), np.tile([0.0, 0.0, -9.80665], (t.size, 1)), np.tile([2e-5, 0.0, 4e-5], (t.size, 1)))
    for item in estimators.items(",".join(specs)):
        name = item.partition(":")[0].partition("@")[0]
        for one in BUILT_IN if name == "all" else [item] if name in ("default", *BUILT_IN) else []:
            with suppress(Exception):
                for row in estimators.select(one):
                    estimators.estimate(row, t, *rest)
