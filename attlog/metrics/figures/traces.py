"""Arrays for the figures: what the numbers were computed from, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import running
from attlog.metrics.base import Case, per_times
from attlog.metrics.drift import air as drift_air
from attlog.metrics.drift import rest as drift_rest
from attlog.metrics.drift import slope as drift
from attlog.metrics.evidence.samples import deviations
from attlog.metrics.figures.height import height_trace
from attlog.metrics.figures.rest import RestTraces
from attlog.metrics.figures.sensors import sensor_traces
from attlog.metrics.figures.setpoint import demanded, response
from attlog.metrics.figures.steps import step_traces
from attlog.metrics.figures.trace import Budget, Share, Trace, envelope
from attlog.metrics.noise import allan
from attlog.reference.model import Reference, Row

Array = NDArray[np.float64]


def traces(case: Case, rows: Iterable[Row]) -> list[Trace]:
    """All traces of all rows, figure by figure within a row; see :class:`Trace` for their columns.

    A reference that is no row (truth, smoother) comes first, with its attitude alone; what is drawn
    of all rows together and of the sensors comes last. Long logs become envelopes.
    """
    rows = list(rows)
    replays = [row for row in rows if row.kind == "replay"]
    drawing = Drawing(case, len(replays), [row for row in rows if row.kind != "replay"])
    drawn = [trace for row in rows for trace in drawing.of_row(row)]
    return [*drawing.first(rows), *drawn, *drawing.last()]


class Drawing:
    """The traces of rows that pass one by one, so that each can be released once it is drawn.

    ``replays``: how many replayed rows will pass; ``onboard``: the rows that pass after them. How many points each may
    have follows from how many there are.
    """

    def __init__(self, case: Case, replays: int, onboard: Sequence[Row]) -> None:
        self.case = case
        alone = len(case.reference.t) if case.reference.kind in ("truth", "smoother") else 0
        self._angles = Budget(replays, alone + sum(len(row.t) for row in onboard))
        self._errors = Budget(replays, sum(len(row.errors.t) for row in onboard if row.errors is not None))
        self._rest = RestTraces(case, replays, onboard)

    def first(self, rows: Iterable[Row]) -> list[Trace]:
        """The reference, where it is none of the rows."""
        reference = self.case.reference
        if reference.kind not in ("truth", "smoother") or any(row.is_reference for row in rows):
            return []
        share = self._angles.share(len(reference.t), replayed=False)
        return [
            *attitude(reference.kind, reference.t, reference.q, reference.gap_segment, share),
            *own_sigma(reference, share),
        ]

    def of_row(self, row: Row) -> list[Trace]:
        """One row, figure by figure."""
        case, replayed = self.case, row.kind == "replay"
        angles = self._angles.share(len(row.t), replayed)
        errors = self._errors.share(0 if row.errors is None else len(row.errors.t), replayed)
        self._rest.add(row)
        return [
            *attitude(row.name, row.t, row.q, row.segment, angles),
            *difference(case, row, errors),
            *drifts(case, row),
            *allan_curves(case, row),
            *step_traces(case, row),
            *bias(row, angles),
            *onboard_bias(case, row),
            *response(case, row),
        ]

    def last(self) -> list[Trace]:
        """What is drawn of all rows together, of the sensors, the set-point and the height."""
        case = self.case
        return [*demanded(case), *self._rest.drawn(), *sensor_traces(case), *height_trace(case)]


def attitude(name: str, t: Array, q: Array, run: NDArray[np.int64], share: Share) -> list[Trace]:
    """Roll, pitch, heading of attitudes (n, 4) at their own times; NaN after a gap or restart breaks the line."""
    if len(t) == 0:
        return []
    euler = rotation.to_euler(q)
    np.degrees(euler, out=euler)  # in place, as the gaps are: in long logs copies add up
    return [_enveloped("attitude", name, t, _broken(euler, run), ("roll", "pitch", "heading"), share)]


def own_sigma(reference: Reference, share: Share) -> list[Trace]:
    """How wrong a smoother says it may be itself, deg: its tilt, and its heading where that is its own."""
    if reference.sigma_tilt_deg is None or reference.sigma_heading_deg is None:
        return []
    columns = {"inclination": reference.sigma_tilt_deg}
    if reference.heading_by in ("own", "relative"):
        columns["heading"] = reference.sigma_heading_deg
    made = np.column_stack(list(columns.values()))
    return [
        _enveloped("sigma", reference.kind, reference.t, _broken(made, reference.gap_segment), tuple(columns), share)
    ]


def difference(case: Case, row: Row, share: Share) -> list[Trace]:
    """Errors against the reference: total, signed heading, inclination, and differences in roll and pitch."""
    e = row.errors
    if e is None or len(e.t) == 0:
        return []
    columns, tilt = np.empty((len(e.t), 5)), _tilt(case, e.q_ref)
    columns[:, 0], columns[:, 1], columns[:, 2] = e.total, e.heading, e.inclination
    for a in range(0, len(e.t), rotation.BLOCK):  # in long logs copies of all of it add up
        own = slice(a, a + rotation.BLOCK)
        columns[own, 3:] = np.degrees(rotation.wrap(rotation.to_euler(e.q_est[own])[:, :2] - tilt[own]))
    names = ("total", "heading", "inclination", "roll", "pitch")
    return [_enveloped("difference", row.name, e.t, _broken(columns, e.gap_segment), names, share)]


@per_times
def _tilt(case: Case, q: Array) -> Array:
    """Roll and pitch (n, 2) in rad of an attitude (n, 4): of the reference the same for all rows."""
    return np.ascontiguousarray(rotation.to_euler(q)[:, :2])


def drifts(case: Case, row: Row) -> list[Trace]:
    """Heading block means with their line, for the longest rest and for each heading reference in the air."""
    records = [drift_rest.rest_blocks(case, row, usable) for _, usable in drift_rest.rests(case, row, "rest")]
    longest = max(records, key=lambda b: len(b.t), default=None)
    keyed = [("rest", longest)]
    if case.segments.spans("airborne") and not row.is_reference:
        names = [n for n in drift_air.HEADING_REFERENCES if n in case.heading_references or n == case.reference.kind]
        keyed += [(n, drift_air.error_blocks(case, row, n, "airborne")) for n in names if n != row.name]
    found = []
    for key, blocks in keyed:
        if blocks is not None and len(blocks.t) >= drift.MIN_BLOCKS:
            mean = float(np.mean(blocks.e[np.isfinite(blocks.e)])) if np.isfinite(blocks.e).any() else 0.0
            columns = {"heading": blocks.e - mean, "line": drift.line(blocks) - mean}
            columns["heading"][1:][~running(blocks.t)] = np.nan
            found.append(Trace("drift", row.name, blocks.t, columns, key))
    return found


def allan_curves(case: Case, row: Row) -> list[Trace]:
    """Allan deviation of the averaged angle (deg) of the longest rest from 60 s on, ``key`` = axis, ``t`` = tau."""
    segment = allan.longest_rest(case, row, "all")
    if segment is None or row.t[segment.stop - 1] - row.t[segment.start] < allan.SHORTEST_S:
        return []
    step = float(row.t[segment.stop - 1] - row.t[segment.start]) / (segment.stop - segment.start - 1)
    found = []
    for axis, angle in zip(("roll", "pitch", "heading"), deviations(row.q[segment]).T, strict=True):
        d = allan.of_average(angle, step)
        columns = {"tau": d.tau, "deviation": d.sigma, "low": d.low, "high": d.high}
        found.append(Trace("allan", row.name, d.tau, columns, axis))
    return found


def bias(row: Row, share: Share) -> list[Trace]:
    """The filter's own gyro bias estimate in deg/s."""
    if row.bias is None or len(row.t) == 0:
        return []
    return [_enveloped("bias", row.name, row.t, _broken(np.degrees(row.bias), row.segment), ("x", "y", "z"), share)]


def onboard_bias(case: Case, row: Row) -> list[Trace]:
    """The gyro bias in deg/s that the onboard estimator logged, at its own times: drawn with the onboard row."""
    stream = case.log.onboard_gyro_bias
    if row.name != "onboard" or stream is None:
        return []
    share = Share.of([len(stream.t)])
    return [_enveloped("bias", row.name, stream.t, np.degrees(stream.x), ("x", "y", "z"), share)]


def _enveloped(figure: str, name: str, t: Array, columns: Array, names: tuple[str, ...], share: Share) -> Trace:
    at, kept = envelope(t, columns, share(len(t)))
    return Trace(figure, name, at, {n: kept[:, k] for k, n in enumerate(names)}, ratio=len(t) / len(at))


def _broken(columns: Array, run: NDArray[np.int64]) -> Array:
    """The columns (n, k) themselves with NaN where a segment begins, which breaks the line there."""
    columns[np.flatnonzero(np.diff(run) != 0) + 1] = np.nan
    return columns
