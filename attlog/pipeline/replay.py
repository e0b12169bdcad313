"""Run estimators over a Case: aligned tracks and rows of the result's table."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from attlog import estimators, reference
from attlog.core.errors import AttlogError, PluginError, UsageError, call_guarded
from attlog.core.jit import build, store
from attlog.core.spans import Span
from attlog.estimators.interface import Estimate
from attlog.estimators.registry import FLOWN
from attlog.flight.model import FlightLog, Imu, Mag
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Case, per_case
from attlog.pipeline import inputs
from attlog.reference import alignment
from attlog.reference.model import Track
from attlog.result import EstimatorRow, ParameterValue
from attlog.segments import model
from attlog.segments.model import Segments

# Logs the name of each filter as it starts.
STAGES = logging.getLogger("attlog.stages")
# Heading sigma below which both firmwares use a heading from GNSS motion (EKFGSF_yaw_err_max,
# GSF_YAW_ACCURACY_THRESHOLD_DEG).
KNOWN_RAD = np.deg2rad(15.0)


class Runnable(Protocol):
    """Row defined by more than a filter name: changed inputs or an external attitude."""

    @property
    def name(self) -> str:
        """Name of the row."""

    @property
    def row(self) -> estimators.EstimatorSpec:
        """The filter that runs."""

    def run(self, case: Case, imu: Imu, suffix: str) -> tuple[Track, EstimatorRow]:
        """Return track and table row of one unit. AttlogError on failure."""


# A row to run, or the error of a plug-in that cannot be loaded.
Chosen: TypeAlias = estimators.EstimatorSpec | Runnable | PluginError


def run_rows(case: Case, specs: Sequence[str]) -> list[Track]:
    """Run the named estimators and return their aligned attitudes; raise the first failure."""
    rows = select_rows(specs, case.log).values()
    return [_run(case, imu, spec, suffix)[0] for suffix, imu in case.imus.items() for spec in rows]


def smoother(
    log: FlightLog, segments: Segments, options: reference.ReferenceOptions, *, compass: bool = True
) -> Estimate:
    """Run the whole-log smoother on the IMU that flew.

    Segments between gaps and impacts run separately; segments that fail their own checks are left out. Where an aid
    contradicts the others for long, the barometer is left out, else the GNSS position. The lag of the IMU's filters is
    corrected. ``compass`` False ignores the compass. UsageError for a log too long, without
    accelerometer, or with too little left.
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
        field = field._replace(declination_deg=north)
    aids, facts = inputs.aids_of(log, segments, imu, field), inputs.facts_of(log, segments, imu, north)
    t = imu.gyro.t_best
    mag = None if log.mag is None or not compass else log.mags[log.mag]

    def smoothed(span: Span, aids: estimators.Aids) -> Estimate:
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

    found = [smoothed(span, aids) for span in spans]
    try:
        return reference.join_segments(found, whatever=asked)
    except UsageError:
        if aids.baro is None or aids.position is None or not reference.aid_contradicted(found):
            raise
        # of two heights that contradict each other one is wrong
        for fewer in (replace(aids, baro=None), replace(aids, position=None)):
            with suppress(UsageError):
                return reference.join_segments([smoothed(span, fewer) for span in spans])
        raise


def replays(
    case: Case, specs: Mapping[str, Chosen], failed: dict[str, AttlogError] | None = None
) -> Iterator[tuple[Track | None, EstimatorRow]]:
    """Yield each chosen estimator as track and table row.

    A failed one has no track and status ``failed``; ``failed`` collects the errors by row name.
    """
    for suffix, imu in case.imus.items():
        for name, spec in specs.items():
            kind = "rerun" if is_rerun(spec) else "replay"
            if kind == "rerun" and imu is not case.log.replay_imu:
                continue  # the onboard filter is re-run on one IMU only

            def bug(sentence: str, name: str = name + suffix, kind: str = kind) -> tuple[None, EstimatorRow]:
                return None, EstimatorRow(name, kind, name, "failed", sentence)

            try:
                yield call_guarded(name, partial(_run, case, imu, spec, suffix, whole=False), bug)
            except AttlogError as error:
                if failed is not None:  # anew: frames of its traceback and of its causes hold the arrays of the run
                    failed[name + suffix] = type(error)(str(error))
                yield bug(str(error))


def estimate_log(
    spec: estimators.EstimatorSpec,
    source: FlightLog | Case | Path | str,
    *,
    q0: ArrayLike | None = None,
    declination: float | None = None,
    every: int = 1,
) -> Estimate:
    """Run a filter over a log's own samples; see :func:`attlog.estimate`.

    The attitude is that of the IMU: neither trim nor heading offset is removed. LogUnusable without an IMU.
    """
    from attlog.pipeline.preparation import prepare

    case = source if isinstance(source, Case) else prepare(source, reference="none")
    imu = case.log.replay_imu
    if imu is None:
        raise UsageError(f"{case.log.path}: holds no IMU that a filter could run on")
    estimator = spec.estimator
    if is_rerun(spec) or is_recorded(spec):
        if q0 is not None or declination is not None or every != 1:
            raise UsageError(f"{spec.name}: takes none of q0, declination and every")
        if is_recorded(spec):
            from attlog.external.attitude import read_attitude

            values = {name: value for name, (value, _) in spec.resolved().items()}
            return read_attitude(Path(estimator.origin), case.log, imu, values)
        from attlog.pipeline.onboard_rerun import run_again

        asked = {key: estimator.parameter(key).check(value, estimator.name) for key, value in spec.params.items()}
        changes = {key: float(value) for key, value in asked.items()}
        return run_again(case, imu, estimator.name, changes).estimate(case.log.t0_us * 1e-6)
    suffix = next(name for name, unit in case.imus.items() if unit is imu)
    mag = None if case.log.mag is None else case.log.mags[case.log.mag]
    samples, facts = _inputs(case, imu, mag, estimator, log_facts(case, suffix), aids_of(case, suffix))
    found = estimators.estimate(spec, *samples, **facts, q0=q0, declination=declination, every=every)
    taken = case.bias_of(imu)
    if found.bias is not None and taken.taken != "none":
        found.bias = found.bias + taken.at(found.t)
    return found


def run_again(case: Case, specs: Mapping[str, Chosen], name: str) -> Track:
    """Run one row of :func:`replays` again, and keep all outputs."""
    imu, spec, suffix = next(
        (imu, spec, suffix) for suffix, imu in case.imus.items() for n, spec in specs.items() if n + suffix == name
    )
    return _run(case, imu, spec, suffix)[0]


def select_rows(specs: Sequence[str | Runnable], log: FlightLog) -> dict[str, Chosen]:
    """Return the rows to run by name. UsageError for unknown names.

    A plug-in that cannot be loaded is represented by its error. The sets ``default`` and ``all`` begin with the filter
    that flew.
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
    """Return the flown filter if a set of estimators includes it.

    Empty if it is also named explicitly, or if attlog has no such filter.
    """
    from attlog.pipeline.onboard_rerun import flown_filter  # imported late: `attlog info` does not need it

    named = {item for text in specs if isinstance(text, str) for item in estimators.items(text)}
    flown = flown_filter(log) if named & {"default", "all"} else ""
    return "" if flown in named else flown


@per_case
def log_facts(case: Case, suffix: str) -> estimators.LogFacts:
    """Return the logged parameters and facts for filters that replay a unit."""
    return inputs.facts_of(case.log, case.segments, case.imus[suffix], case.reference.alignment.declination_deg)


@per_case
def aids_of(case: Case, suffix: str) -> estimators.Aids:
    """Return the logged aids for filters that replay a unit."""
    return inputs.aids_of(case.log, case.segments, case.imus[suffix], alignment.earth_field(case.log))


def _run(case: Case, imu: Imu, spec: Chosen, suffix: str, whole: bool = True) -> tuple[Track, EstimatorRow]:
    """Run one estimator over one IMU; ``whole`` as of :func:`replayed`. The error of a plug-in is raised."""
    if isinstance(spec, PluginError):
        raise spec
    STAGES.info("running %s", spec.name)
    if not isinstance(spec, estimators.EstimatorSpec):
        return spec.run(case, imu, suffix)
    if is_recorded(spec):
        return recorded_row(case, imu, spec, spec.name + suffix)
    if is_rerun(spec):
        from attlog.pipeline.onboard_rerun import rerun_row  # no other row needs it

        return rerun_row(case, imu, spec, spec.name + suffix)
    mag = None if case.log.mag is None else case.log.mags[case.log.mag]
    return replayed(case, imu, mag, spec, log_facts(case, suffix), aids_of(case, suffix), spec.name + suffix, whole)


def is_rerun(spec: Chosen) -> bool:
    """Return whether a row is a re-run of the flown filter."""
    return isinstance(spec, estimators.EstimatorSpec) and spec.estimator.name in FLOWN


def is_recorded(spec: estimators.EstimatorSpec) -> bool:
    """Return whether a row is an attitude computed elsewhere."""
    return estimators.is_recorded(spec.estimator.origin)


def recorded_row(case: Case, imu: Imu, spec: estimators.EstimatorSpec, name: str) -> tuple[Track, EstimatorRow]:
    """Return an external attitude as a row. Errors as of :func:`attlog.external.attitude.read_attitude`."""
    from attlog.external import attitude  # no other row needs it

    values = spec.resolved()
    asked = {k: v for k, (v, _) in values.items()}
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
    return row, table_row(row, spec, values)


def replayed(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    spec: estimators.EstimatorSpec,
    known: estimators.LogFacts,
    aids: estimators.Aids,
    name: str,
    whole: bool = True,
) -> tuple[Track, EstimatorRow]:
    """Run one estimator over an IMU and a magnetometer; align its attitude.

    ``whole`` False drops other outputs (``aux``), which no metric reads and which are as large as the attitude.
    """
    samples, facts = _inputs(case, imu, mag, spec.estimator, known, aids)
    estimate, t = estimators.estimate(spec, *samples, **facts), samples[0]
    if np.array_equal(estimate.t, t):
        estimate.t = t  # share one time array between rows: copies add up in long logs
    values = spec.resolved(known)
    row = _track(case, imu, mag, spec, values, estimate, name, whole)
    row.equation = spec.estimator.equation
    return row, table_row(row, spec, values)


def batch(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    spec: estimators.EstimatorSpec,
    settings: Sequence[Mapping[str, float | str]],
    known: estimators.LogFacts,
    aids: estimators.Aids,
) -> list[Track]:
    """Run one filter with many parameter sets side by side.

    Each track equals that of :func:`replayed`. ``settings`` override the parameters of ``spec``. UsageError for values
    out of range or a missing sensor, PluginError of a plug-in.
    """
    from attlog.estimators.batch import estimate_batch

    estimator = spec.estimator
    if "mag" in estimator.needs and mag is None:
        raise UsageError(f"{estimator.name} needs a magnetometer; the log holds none")
    if "gnss" in estimator.needs and aids.velocity is None:
        raise UsageError(f"{estimator.name} needs gnss, which was not given")
    STAGES.info("running %s with %d parameter sets", spec.name, len(settings))
    samples, facts = _inputs(case, imu, mag, estimator, known, aids)
    sets = [estimators.EstimatorSpec(estimator, spec.preset, {**spec.params, **setting}) for setting in settings]
    found = estimate_batch(estimator, [one.params for one in sets], *samples, preset=spec.preset, **facts)
    return [
        _track(case, imu, mag, one, one.resolved(known), estimate, one.name, whole=False)
        for one, estimate in zip(sets, found, strict=True)
    ]


def _track(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    spec: estimators.EstimatorSpec,
    values: Mapping[str, tuple[float | str, str]],
    estimate: Estimate,
    name: str,
    whole: bool,
) -> Track:
    """Convert an estimate to an aligned track of an IMU."""
    estimator = spec.estimator
    north_by_gnss = "gnss" in estimator.needs and wait_for_motion(estimate)
    if not whole:
        estimate.aux = {}
    row = reference.replayed(
        case.log,
        case.segments,
        case.reference,
        estimate,
        name=name,
        estimator=estimator.origin if estimator.origin.endswith(".py") else estimator.name,
        parameters={k: v for k, (v, _) in values.items()},
        uses_mag=mag is not None and "mag" in estimator.uses,
        north_by_gnss=north_by_gnss,
    )
    row.imu, row.quality, row.aux = imu, dict(estimate.quality), dict(estimate.aux)
    _add_common_bias(row, case.bias_of(imu))
    return row


def wait_for_motion(estimate: Estimate) -> bool:
    """Mark the time until GNSS motion gives a heading, in each segment.

    False where the filter reports no sigma. UsageError where motion never gave one: with such a row, all rows would
    share no time for a comparison.
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


def _inputs(
    case: Case,
    imu: Imu,
    mag: Mag | None,
    estimator: estimators.Estimator,
    known: estimators.LogFacts,
    aids: estimators.Aids,
) -> tuple[tuple[Any, Any, Any, Any], dict[str, Any]]:
    """Return samples (times, gyro, accelerometer, magnetometer at these times or None) and keywords of a filter.

    A plug-in that runs over the whole log gets the magnetometer at its own times too.
    """
    t = imu.gyro.t_best if case.reference.alignment.clock == "sample" else imu.gyro.t
    uses = mag is not None and "mag" in estimator.uses
    if mag is not None and uses and estimator.run is not None and estimator.origin != "attlog":
        aids = replace(aids, mag=inputs.field_of(mag))
    placed = estimators.place(t, mag.field.t_best, mag.field.x) if mag is not None and uses else None
    facts = {"sampling": imu.gyro.sampling, "dt": imu.dt, "aids": aids, "log": known}
    return (t, case.gyro_of(imu), imu.acc.x, placed), facts


def _add_common_bias(row: Track, taken: CommonBias) -> None:
    """Add the common gyro bias to the row's own bias.

    The sum is the bias of the logged gyro.
    """
    row.estimates_bias = row.bias is not None and bool(np.any(row.bias))
    if row.bias is not None and not row.estimates_bias:
        row.bias = taken.at(row.t)  # a constant takes no memory
    elif row.bias is not None and taken.taken != "none":
        row.bias = row.bias + taken.at(row.t)


def table_row(
    row: Track,
    spec: estimators.EstimatorSpec | None = None,
    values: Mapping[str, tuple[float | str, str]] | None = None,
) -> EstimatorRow:
    """Return the table line of a track, without answers."""
    known = {} if spec is None else {p.name: p for p in spec.estimator.parameters}
    return EstimatorRow(
        row.name,
        row.kind,
        "" if spec is None else spec.estimator.name,
        row.status,
        row.reason,
        row.estimator if spec is None else spec.estimator.title,
        None if spec is None else spec.preset,
        {k: ParameterValue(v, origin, known[k].unit, known[k].meaning) for k, (v, origin) in (values or {}).items()},
        row.is_reference,
        row.causal,
        row.uses_mag,
        row.north_by_gnss,
        row.start,
        row.skipped,
        row.quality,
        row.reproduction,
        row.ns_per_update,
        mode=row.mode,
    )


def preload(specs: Sequence[str]) -> None:
    """Load the loops of an analysis with these filters into a process before it forks, all that flew among them.

    Plug-ins are left out, because their code runs where a log is analysed. Errors are reported there too.
    """
    flown = [name for name in build.flown_names(build.FLOWN) if store.has(build.loop_by_name(name).key)]
    for name in [*build.names_for(specs), *flown]:
        with suppress(Exception):
            build.loop_by_name(name).compiled()
