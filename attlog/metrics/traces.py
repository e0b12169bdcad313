"""Figure data of attitudes, errors and metrics, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.flight.model import without_pauses
from attlog.metrics import allan, drift, setpoint, step_error, step_fit, step_turning
from attlog.metrics.flight_data import flight_data
from attlog.metrics.metric import Case, per_case, per_object
from attlog.metrics.step_error import Curve
from attlog.metrics.step_products import STRIDE_S
from attlog.metrics.step_turning import StepEvent
from attlog.metrics.trace import BUDGET, SampleBudget, Trace, envelope, height_trace, sensor_traces
from attlog.metrics.windows import detrended, own_start, within
from attlog.reference import alignment
from attlog.reference.model import Reference, Track
from attlog.segments import model
from attlog.story.flight_events import Event

Array = NDArray[np.float64]

ANGLES = ("roll", "pitch", "heading")
BINS = 61  # odd: one bin is centred on zero
# Detrending window as in the metric of noise; slower motion is wander.
WINDOW_S = 5.0
MIN_REST_SAMPLES = 10  # fewer give no distribution
# Largest number of values kept for a histogram, spread evenly over their order.
ORDERED = 20_000


class RestTraces:
    """``rest`` and ``spread`` traces of rows added one by one.

    From the longest rest, where finite. ``replays``: number of replayed rows to come; ``onboard``: the rows after them.
    """

    def __init__(self, case: Case, replays: int, onboard: Sequence[Track]) -> None:
        self._case = case
        spans = case.segments.spans("rest")
        self._rest = max(spans, key=lambda s: s[1] - s[0]) if spans else None
        segments = [self._segment(row) for row in onboard]
        self._budget = SampleBudget(replays, sum(p.stop - p.start for p in segments if p is not None))
        self._drawn: list[Trace] = []
        self._scatters: list[Scatter] = []

    def add(self, row: Track) -> None:
        """Add the traces of a row, which may be released afterwards."""
        segment = self._segment(row)
        if segment is None:
            return
        t, angles = row.t[segment], allan.rest_angles(self._case, row, segment)
        self._drawn.append(close_up(row.name, t, angles, self._budget.keep(len(t), row.kind != "onboard")))
        self._scatters.append(Scatter.of(row.name, residual(t, angles[:, :2]).ravel()))

    def drawn(self) -> list[Trace]:
        """Return all traces; the spreads of all rows have equal bins."""
        return [*self._drawn, *spreads(self._scatters)]

    def _segment(self, row: Track) -> slice | None:
        """Return the row's longest usable segment in the rest, or None."""
        if self._rest is None:
            return None
        start = max(self._rest[0], own_start(self._case, row))
        segments = within(row.t, (start, self._rest[1]), row.segment) if start < self._rest[1] else []
        segment = max(segments, key=lambda p: p.stop - p.start, default=None)
        if segment is None or segment.stop - segment.start <= MIN_REST_SAMPLES or not np.isfinite(row.q[segment]).all():
            return None
        return segment


class Scatter(NamedTuple):
    """Values of a row for a histogram: standard deviation, thinned values."""

    row: str
    size: float
    ordered: Array

    @classmethod
    def of(cls, row: str, values: Array) -> Scatter:
        """Return the scatter of values (n,).

        More than ORDERED values are thinned, which keeps shares to 0.005 %.
        """
        size = float(np.std(values)) if len(values) else 0.0
        if len(values) > ORDERED:
            values = np.sort(values)[np.linspace(0, len(values) - 1, ORDERED).round().astype(np.int64)]
        return cls(row, size, values)


def close_up(name: str, t: Array, angles: Array, keep: int) -> Trace:
    """Return detrended angles (n, 3) in deg: noise and wander without drift."""
    flat = detrended(t, angles)
    at, kept = envelope(t, flat, keep)
    return Trace("rest", name, at, {a: kept[:, k] for k, a in enumerate(ANGLES)}, ratio=len(t) / len(at))


def spreads(scatters: Sequence[Scatter]) -> list[Trace]:
    """Return histograms of roll and pitch at rest in percent."""
    scatters = [s for s in scatters if len(s.ordered) > MIN_REST_SAMPLES]
    if not scatters:
        return []
    half = max(3.5 * float(median([s.size for s in scatters])), 1e-4)
    edges = np.linspace(-half, half, BINS + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    shares = [100.0 * np.histogram(s.ordered, edges)[0] / len(s.ordered) for s in scatters]
    return [
        Trace("spread", s.row, middle, {"angle": middle, "share": share})
        for s, share in zip(scatters, shares, strict=True)
    ]


def residual(t: Array, angles: Array) -> Array:
    """Return angles (n, k) detrended in windows of 5 s."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1] + WINDOW_S, WINDOW_S))
    windows = [slice(a, b) for a, b in pairwise(edges) if b - a > 2]
    return np.concatenate([detrended(t[w], angles[w]) for w in windows] or [np.zeros((0, angles.shape[1]))])


# Figure data of steps: a representative one, and statistics over all.

# Times since the onset, s.
GRID_S = np.linspace(-0.3, 1.2, 151)
# Quantiles of band and median: the band has four in five of the events.
SHARES = (0.1, 0.5, 0.9)
# Smallest number of events for a band.
MIN_EVENTS_DRAWN = 3


def step_traces(case: Case, row: Track) -> list[Trace]:
    """Return a representative step, and statistics over steps by axis."""
    if row.is_reference or case.reference.rate < step_fit.MIN_REFERENCE_HZ:
        return []
    curves = step_error.curves(case, row, "all")
    event = representative(case)
    found = [one_step(case, row, curve) for curve in curves if curve.event == event]
    if len(curves) < MIN_EVENTS_DRAWN:
        return found
    axes, (error, moved) = np.array([c.event.axis for c in curves]), in_percent(curves)
    for axis in (None, *range(len(step_turning.AXES))):
        own = np.ones(len(axes), bool) if axis is None else axes == axis
        if np.count_nonzero(own) >= MIN_EVENTS_DRAWN and (axis is not None or len(set(axes.tolist())) > 1):
            found.append(
                step_statistics(row, error[own], moved[own], "all axes" if axis is None else step_turning.AXES[axis])
            )
    return found


@per_case
def representative(case: Case) -> StepEvent | None:
    """Return the median-stroke event about the axis with most events."""
    events = step_turning.reference_steps(case)
    if not events:
        return None
    count = [sum(e.axis == axis for e in events) for axis in range(len(step_turning.AXES))]
    own = sorted((e for e in events if e.axis == int(np.argmax(count))), key=lambda e: (abs(e.delta_deg), e.onset))
    return own[(len(own) - 1) // 2]


def one_step(case: Case, row: Track, curve: Curve) -> Trace:
    """Return the turning of row, reference and set-point in one event."""
    columns = {"est": curve.row, "ref": curve.reference}
    wanted = step_error.setpoint(case, curve)
    if wanted is not None:
        columns["set"] = wanted
    event = curve.event
    return Trace("step", row.name, curve.seconds, columns, f"{step_turning.AXES[event.axis]}@{event.onset:.2f}")


def in_percent(curves: list[Curve]) -> tuple[Array, Array]:
    """Return the row's error and the reference's turning in % of stroke."""
    stroke = np.array([abs(c.event.delta_deg) for c in curves])[:, None]
    error = resampled_errors(curves, [c.error for c in curves]) / stroke * 100.0
    return error, resampled_errors(curves, [c.reference for c in curves]) / stroke * 100.0


def step_statistics(row: Track, error: Array, moved: Array, axis: str) -> Trace:
    """Return median and band of the row's error over events.

    ``error``, ``moved`` (events, times) in %; NaN where few events reach.
    """
    enough = np.isfinite(error).sum(axis=0) >= MIN_EVENTS_DRAWN
    columns = {name: np.full(len(GRID_S), np.nan) for name in ("median", "low", "high", "ref")}
    columns["low"][enough], columns["median"][enough], columns["high"][enough] = known_steps(error[:, enough], SHARES)
    columns["ref"][enough] = known_steps(moved[:, enough], (0.5,))[0]
    return Trace("steps", row.name, GRID_S, columns, axis, values={"events": float(len(error))})


def known_steps(x: Array, shares: tuple[float, ...]) -> Array:
    """Return quantiles (len(shares), n) of the finite values per column.

    ``x`` (k, n) with at least one finite value per column. Equal to numpy.nanquantile, which loops over columns.
    """
    ordered, known = np.sort(x, axis=0), np.isfinite(x).sum(axis=0)
    found = np.empty((len(shares), x.shape[1]))
    for k, share in enumerate(shares):
        place = share * (known - 1)
        below = np.floor(place).astype(np.int64)
        low, high = (np.take_along_axis(ordered, i[None], axis=0)[0] for i in (below, np.minimum(below + 1, known - 1)))
        found[k] = low + (place - below) * (high - low)
    return found


def resampled_errors(curves: list[Curve], values: list[Array]) -> Array:
    """Return values of each curve on GRID_S (events, times)."""
    begin = STRIDE_S * np.arange(len(curves))
    seconds = [c.seconds for c in curves]
    at = GRID_S + begin[:, None]
    found = np.interp(at, np.concatenate([s + b for s, b in zip(seconds, begin, strict=True)]), np.concatenate(values))
    low, high = (np.array([s[k] for s in seconds])[:, None] for k in (0, -1))
    return np.where((low <= GRID_S) & (high >= GRID_S), found, np.nan)


# Figure data of the attitude set-point: demand over the flight, and response to a step.

# Largest number of points of the demanded angles.
MAX_DEMAND_POINTS = 25_000


def demand_traces(case: Case) -> list[Trace]:
    """Return the set-point's roll, pitch and heading while armed, else throughout."""
    wanted = case.log.setpoints.attitude
    if wanted is None:
        return []
    armed = case.segments.spans("armed") or case.segments.spans("all")
    own = np.zeros(len(wanted.t), bool)
    for a, b in armed:
        own |= (wanted.t >= a) & (wanted.t <= b)
    t, q = model.select_rising(np.where(own, wanted.t, np.nan), wanted.q)
    if len(t) < 2:
        return []
    if case.reference.alignment.trim is not None and not wanted.has_trim:
        q = alignment.apply_trim(q, case.reference.alignment.trim)
    angles = np.degrees(rotation.to_euler(q))
    angles[np.flatnonzero(np.diff(model.number_segments(t)) != 0) + 1] = np.nan
    at, kept = envelope(t, angles, MAX_DEMAND_POINTS)
    columns = {name: kept[:, k] for k, name in enumerate(("roll", "pitch", "heading"))}
    return [Trace("demand", "", at, columns, ratio=len(t) / len(at))]


def setpoint_traces(case: Case, row: Track) -> list[Trace]:
    """Return the response to a unit step of the set-point (onboard row)."""
    blocks = setpoint.moved(case, "all") if row.name == "onboard" else None
    if blocks is None or len(blocks.axis) < setpoint.MIN_BLOCKS:
        return []
    columns, t = {}, np.zeros(0)
    for axis, name in enumerate(("roll", "pitch")):
        own = blocks.axis == axis
        if own.sum() >= setpoint.MIN_BLOCKS // 2:
            t, columns[name] = setpoint.step_response(blocks.only(own))
    return [Trace("setpoint", row.name, t, columns)] if columns else []


# Figure data of all rows.


def traces(case: Case, rows: Iterable[Track]) -> list[Trace]:
    """Return all traces of all rows, figure by figure within a row.

    A reference that is no row (truth, smoother) comes first, with its attitude alone; traces of all rows together and
    of the sensors come last. See :class:`Trace`.
    """
    rows = list(rows)
    replays = [row for row in rows if row.kind != "onboard"]
    drawing = Drawing(case, len(replays), [row for row in rows if row.kind == "onboard"])
    drawn = [trace for row in rows for trace in drawing.of_row(row)]
    return [*drawing.first(rows), *drawn, *drawing.last()]


class Drawing:
    """Traces of rows added one by one, each released when drawn.

    ``replays``: number of replayed rows to come; ``onboard``: the rows after them.
    """

    def __init__(self, case: Case, replays: int, onboard: Sequence[Track]) -> None:
        self.case = case
        alone = len(case.reference.t) if case.reference.kind in ("truth", "smoother") else 0
        self._angles = SampleBudget(replays, alone + sum(len(row.t) for row in onboard))
        self._errors = SampleBudget(replays, sum(len(row.errors.t) for row in onboard if row.errors is not None))
        self._rest = RestTraces(case, replays, onboard)

    def first(self, rows: Iterable[Track]) -> list[Trace]:
        """Return the traces of a reference that is not a row."""
        reference = self.case.reference
        if reference.kind not in ("truth", "smoother") or any(row.is_reference for row in rows):
            return []
        keep = self._angles.keep(len(reference.t), replayed=False)
        return [
            *attitude(reference.kind, reference.t, reference.q, reference.gap_segment, keep),
            *own_sigma(reference, keep),
        ]

    def of_row(self, row: Track) -> list[Trace]:
        """Return the traces of one row, figure by figure."""
        case, replayed = self.case, row.kind != "onboard"
        angles = self._angles.keep(len(row.t), replayed)
        errors = self._errors.keep(0 if row.errors is None else len(row.errors.t), replayed)
        self._rest.add(row)
        return [
            *attitude(row.name, row.t, row.q, row.segment, angles),
            *difference(case, row, errors),
            *drifts(case, row),
            *allan_curves(case, row),
            *step_traces(case, row),
            *bias(row, angles),
            *onboard_bias(case, row),
            *setpoint_traces(case, row),
        ]

    def last(self, events: Sequence[Event] = ()) -> list[Trace]:
        """Return the traces of all rows together, sensors, set-point, height and flight data."""
        case = self.case
        data = flight_data(case.log, case.segments.spans("airborne"), events)
        height = height_trace(case.log, case.segments)
        return [*demand_traces(case), *self._rest.drawn(), *sensor_traces(case), *height, *data]


def attitude(name: str, t: Array, q: Array, run: NDArray[np.int64], keep: int) -> list[Trace]:
    """Return roll, pitch, heading; NaN breaks the line at segment changes."""
    if len(t) == 0:
        return []
    euler = rotation.to_euler(q)
    np.degrees(euler, out=euler)  # in place, to save memory in long logs
    return [_enveloped("attitude", name, t, _broken(euler, run), ("roll", "pitch", "heading"), keep)]


def own_sigma(reference: Reference, keep: int) -> list[Trace]:
    """Return the reference's sigma in deg, of heading only if its own."""
    if reference.sigma is None:
        return []
    columns = {"tilt": reference.sigma.tilt_deg}
    if reference.heading.by in ("own", "relative"):
        columns["heading"] = reference.sigma.heading_deg
    made = np.column_stack(list(columns.values()))
    return [
        _enveloped("sigma", reference.kind, reference.t, _broken(made, reference.gap_segment), tuple(columns), keep)
    ]


def difference(case: Case, row: Track, keep: int) -> list[Trace]:
    """Return errors against the reference in deg."""
    e = row.errors
    if e is None or len(e.t) == 0:
        return []
    columns, tilt = np.empty((len(e.t), 5)), _tilt(case, e.q_ref)
    columns[:, 0], columns[:, 1], columns[:, 2] = e.total, e.heading, e.tilt
    for a in range(0, len(e.t), rotation.BLOCK_ROWS):  # in blocks, to save memory in long logs
        own = slice(a, a + rotation.BLOCK_ROWS)
        columns[own, 3:] = np.degrees(rotation.wrap(rotation.to_euler(e.q_est[own])[:, :2] - tilt[own]))
    names = ("total", "heading", "tilt", "roll", "pitch")
    return [_enveloped("difference", row.name, e.t, _broken(columns, e.gap_segment), names, keep)]


@per_object
def _tilt(case: Case, q: Array) -> Array:
    """Return roll and pitch (n, 2) in rad of attitudes (n, 4)."""
    return np.ascontiguousarray(rotation.to_euler(q)[:, :2])


def drifts(case: Case, row: Track) -> list[Trace]:
    """Return heading block means with their line."""
    records = [drift.rest_blocks(case, row, usable) for _, usable in drift.usable_rests(case, row, "rest")]
    longest = max(records, key=lambda b: len(b.t), default=None)
    keyed = [("rest", longest)]
    if case.segments.spans("airborne") and not row.is_reference:
        names = [n for n in drift.HEADING_REFERENCES if n in case.heading_references or n == case.reference.kind]
        keyed += [(n, drift.error_blocks(case, row, n, "airborne")) for n in names if n != row.name]
    found = []
    for key, blocks in keyed:
        if blocks is not None and len(blocks.t) >= drift.MIN_BLOCKS:
            mean = float(np.mean(blocks.e[np.isfinite(blocks.e)])) if np.isfinite(blocks.e).any() else 0.0
            columns = {"heading": blocks.e - mean, "line": drift.drift_line(blocks) - mean}
            columns["heading"][1:][~without_pauses(blocks.t)] = np.nan
            found.append(Trace("drift", row.name, blocks.t, columns, key))
    return found


def allan_curves(case: Case, row: Track) -> list[Trace]:
    """Return Allan deviations (deg) of the averaged angles at rest."""
    segment = allan.longest_rest(case, row, "all")
    if segment is None or row.t[segment.stop - 1] - row.t[segment.start] < allan.SHORTEST_S:
        return []
    step = float(row.t[segment.stop - 1] - row.t[segment.start]) / (segment.stop - segment.start - 1)
    found = []
    for axis, angle in zip(("roll", "pitch", "heading"), allan.rest_angles(case, row, segment).T, strict=True):
        d = allan.average_deviation(angle, step)
        columns = {"tau": d.tau, "deviation": d.sigma, "low": d.low, "high": d.high}
        found.append(Trace("allan", row.name, d.tau, columns, axis))
    return found


def bias(row: Track, keep: int) -> list[Trace]:
    """Return the filter's own gyro bias estimate in deg/s."""
    if row.bias is None or len(row.t) == 0:
        return []
    return [_enveloped("bias", row.name, row.t, _broken(np.degrees(row.bias), row.segment), ("x", "y", "z"), keep)]


def onboard_bias(case: Case, row: Track) -> list[Trace]:
    """Return the onboard estimator's logged gyro bias in deg/s."""
    stream = case.log.estimator.gyro_bias
    if row.name != "onboard" or stream is None:
        return []
    return [_enveloped("bias", row.name, stream.t, np.degrees(stream.x), ("x", "y", "z"), min(len(stream.t), BUDGET))]


def _enveloped(figure: str, name: str, t: Array, columns: Array, names: tuple[str, ...], keep: int) -> Trace:
    at, kept = envelope(t, columns, keep)
    return Trace(figure, name, at, {n: kept[:, k] for k, n in enumerate(names)}, ratio=len(t) / len(at))


def _broken(columns: Array, run: NDArray[np.int64]) -> Array:
    """Set NaN in columns (n, k) where a segment begins; return them."""
    columns[np.flatnonzero(np.diff(run) != 0) + 1] = np.nan
    return columns
