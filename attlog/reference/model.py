"""Types of a comparison: the aligned reference, attitude tracks, and their errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span
from attlog.flight.model import Imu, TruthFit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReferenceOptions:
    """How to choose and align the reference.

    ``reference``: auto, truth, smoother, onboard, onboard:NAME or none. ``clock``: sample (times of measurement) or
    publication. ``declination``: auto, model, param or degrees. ``trim``: take the vehicle's trim out of replays.
    ``input_delay``: auto, off or ms. ``score_from``: seconds, None for 15 s after the first IMU sample.
    """

    reference: str = "auto"
    clock: str = "sample"
    declination: str | float = "auto"
    trim: bool = True
    input_delay: str | float = "auto"
    score_from: float | None = None


@dataclass(frozen=True, slots=True)
class AlignmentStep:
    """One decision between raw attitudes and a fair comparison, printed with value and source.

    ``name``: clock, input_delay, resampling, declination, trim, heading_offset, scoring_start, ... ``applied`` is False
    where the step was unnecessary or switched off; ``option`` is the command-line switch that changes it.
    """

    name: str
    text: str
    value: float | str | None = None
    unit: str = ""
    source: str = ""
    applied: bool = True
    option: str = ""


@dataclass(frozen=True, slots=True)
class ReferenceSamples:
    """The reference at the times of a row, kept for rows that follow with the same times.

    ``own`` are the reference's attitudes, ``of`` (n,) the row's times, ``number`` (n,) its segments between gaps,
    ``faster`` whether it is. ``known`` (k,): the reference has an attitude at the times of the slower one, ``good``
    (k,): the row has one too; there ``t`` (m,), attitudes ``q`` (m, 4) and indices ``where`` (m,) of the samples
    before.
    """

    own: Array
    of: Array
    number: NDArray[np.int64]
    faster: bool
    known: NDArray[np.bool_]
    good: NDArray[np.bool_]
    t: Array
    q: Array
    where: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SensorFault:
    """Contradiction of a sensor: a clause, its number, where, and how often."""

    why: str
    value: float | None = None
    unit: str = ""
    t: float | None = None
    count: int = 1
    # Whether a smoother with this sensor has a small sigma and a wrong attitude.
    misleads: bool = True


@dataclass(frozen=True, slots=True)
class GyroJump:
    """A step of the gyro's bias at ``t`` s by ``size_dps`` about x, y, z, one sigma ``sigma_dps``, both in deg/s."""

    t: float
    size_dps: tuple[float, float, float]
    sigma_dps: tuple[float, float, float]


@dataclass(slots=True)
class Alignment:
    """Alignment of a raw attitude to the reference, with its ``steps``.

    ``trim`` (3,) rad is removed from attitudes of the IMU before a comparison. ``input_delay_s`` is the delay of the
    logged gyro that is subtracted from lags. ``floor_deg`` is the smallest difference that the log resolves,
    ``step_deg`` the step of the logged attitude.
    """

    clock: Literal["sample", "publication"] = "sample"
    trim: Array | None = None
    declination_deg: float | None = None
    input_delay_s: float = 0.0
    floor_deg: float = 0.0
    step_deg: float = 0.0
    steps: list[AlignmentStep] = field(default_factory=list)


@dataclass(slots=True)
class Scoring:
    """Scored time: from ``start`` to ``end`` (an impact) s, without the ``unscored`` spans.

    ``refuted``: spans in which gravity at standstill contradicts a smoother.
    """

    start: float = 0.0
    end: float = np.inf
    unscored: list[Span] = field(default_factory=list)
    refuted: list[Span] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSigma:
    """One sigma (n,) deg of the tilt and heading of a smoother or an external truth."""

    tilt_deg: Array
    heading_deg: Array


@dataclass(slots=True)
class HeadingOrigin:
    """Origin of a reference's north: its ``own``, the ``onboard`` attitude, or unknown.

    Of a ``relative`` heading only changes are compared, of ``nobody``'s nothing; ``why`` is the reason.
    """

    by: Literal["own", "onboard", "relative", "nobody"] = "own"
    why: str = ""


@dataclass(slots=True)
class Faults:
    """Sentences on what physics contradicts; empty where nothing is contradicted.

    ``reference``: why agreement with it means nothing. ``doubt``: why one that was asked for would have been refused.
    ``refused``: attitudes that were not taken (truth, smoother, onboard). ``onboard``: error of the onboard attitude by
    the smoother. ``onboard_heading``: its heading by GNSS acceleration. ``gyro``: why nothing made of the gyro can be
    judged. ``sensors``: faults of replayed sensors by name.
    """

    reference: str = ""
    doubt: str = ""
    refused: dict[str, str] = field(default_factory=dict)
    onboard: str = ""
    onboard_heading: str = ""
    gyro: str = ""
    sensors: dict[str, SensorFault] = field(default_factory=dict)


@dataclass(slots=True)
class Reference:
    """The attitude to compare with, by ``kind`` of evidence.

    ``q`` (n, 4) at ``t`` (n,) s; ``gap_segment`` (n,) numbers the segments between gaps, ``segment`` (n,) those between
    gaps and resets. ``name`` is that of an onboard attitude in the log. ``quality`` is what a smoother reports of
    itself, ``gyro_jumps`` the steps of the gyro bias that it found (None where it looks for none). ``fit`` is that of
    an external truth. ``second``: a smoother that is used if the onboard attitude is refused later.
    """

    kind: Literal["truth", "smoother", "onboard", "none"]
    source: str
    t: Array
    q: Array
    gap_segment: NDArray[np.int64]
    segment: NDArray[np.int64]
    rate: float = 0.0
    name: str = ""
    alignment: Alignment = field(default_factory=Alignment)
    scoring: Scoring = field(default_factory=Scoring)
    sigma: ReferenceSigma | None = None
    heading: HeadingOrigin = field(default_factory=HeadingOrigin)
    faults: Faults = field(default_factory=Faults)
    quality: dict[str, float | str] = field(default_factory=dict)
    gyro_jumps: tuple[GyroJump, ...] | None = None
    fit: TruthFit | None = None
    second: Reference | None = None
    # Delays of the gyros of units, and the samples at the times of the last row.
    delays: list[tuple[Imu, tuple[float, float] | None]] = field(default_factory=list, repr=False)
    samples: ReferenceSamples | None = field(default=None, repr=False, compare=False)


@dataclass(slots=True)
class AttitudeErrors:
    """A track against the reference, at the slower one's own times (the reference is never upsampled).

    All (n,) in degrees; ``heading`` is signed. ``gap_segment`` and ``segment`` as in :class:`Reference`. ``scored``
    marks the samples after the scoring start.
    """

    t: Array
    total: Array
    heading: Array
    tilt: Array
    gap_segment: NDArray[np.int64]
    segment: NDArray[np.int64]
    scored: NDArray[np.bool_]
    q_est: Array
    q_ref: Array


@dataclass(frozen=True, slots=True)
class Reproduction:
    """How closely a re-run of the onboard filter follows the attitude that flew.

    Medians and 95 % quantiles of the difference over ``n`` records in ``seconds``, in the air where the log flew.
    ``start``: ``warm`` from logged states, ``cold`` from gravity. ``leaves_s``: first time apart, s on the log's clock.
    """

    tilt_median_deg: float
    tilt_p95_deg: float
    heading_median_deg: float
    heading_p95_deg: float
    n: int
    seconds: float
    airborne: bool
    start: str
    follows: bool
    leaves_s: float | None = None


@dataclass(slots=True, eq=False, weakref_slot=True)
class Track:
    """An aligned attitude over time, one row of the comparison: a replayed estimate or an onboard attitude.

    Equal only to itself. ``name`` as in the result (``mahony@xu-0.6``, ``onboard``, ``onboard:AHR2``). ``t``, ``q`` are
    at its own times with trim, declination and heading offset applied. ``segment`` (n,) counts restarts. ``start`` is
    the time of its first attitude. ``estimator`` is the key of :func:`attlog.estimators.get`: a name or a user's file;
    of onboard tracks the attitude's name in the log. ``kind``: ``replay`` of a filter, ``onboard``, or ``rerun`` of the
    filter that flew, which is never ranked. ``ns_per_update`` is None for onboard tracks. ``status``: ok, diverged,
    not_converged, failed; ``reason`` the sentence for it.
    """

    name: str
    kind: Literal["replay", "onboard", "rerun"]
    t: Array
    q: Array
    segment: NDArray[np.int64]
    uses_mag: bool
    north_by_gnss: bool = False
    start: float = 0.0
    causal: bool = True
    # Gyro bias (n, 3) rad/s that the row subtracts from the logged gyro, with what every row has subtracted.
    bias: Array | None = None
    # Whether part of ``bias`` is the row's own estimate.
    estimates_bias: bool = True
    errors: AttitudeErrors | None = None
    status: str = "ok"
    reason: str = ""
    is_reference: bool = False
    step_deg: float = 0.0
    skipped: dict[str, int] = field(default_factory=dict)
    ns_per_update: float | None = None
    coverage_pct: float | None = None
    convergence_s: float | None = None
    estimator: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    # The equation that the filter's file declares; empty where it is its own.
    equation: str = ""
    # Whether the reference has its heading from this row: then its heading errors mean nothing.
    heading_shared: bool = False
    # Heading that was taken out of ``q`` (of its first segment), None where the heading is the row's own.
    heading_offset_deg: float | None = None
    # What was done to this row alone: trim, heading offset.
    steps: list[AlignmentStep] = field(default_factory=list)
    # The unit that was replayed; None for the one that the log's rows share.
    imu: Imu | None = None
    # What an estimator that sees the whole run says of itself.
    quality: dict[str, float | str] = field(default_factory=dict)
    reproduction: Reproduction | None = None
    # What else the estimator gave at every sample, (n,) or (n, k) by name.
    aux: dict[str, Array] = field(default_factory=dict)

    @property
    def knows_north(self) -> bool:
        """Whether compass or GNSS motion gives it a heading of its own."""
        return self.uses_mag or self.north_by_gnss

    def release(self) -> None:
        """Drop all arrays with a value for each sample."""
        self.t, self.q, self.segment = np.zeros(0), np.zeros((0, 4)), np.zeros(0, np.int64)
        self.bias = self.errors = None
        self.aux = {}


@dataclass(slots=True)
class HeadingReference:
    """Heading from another source: degrees (n,) at ``t``; ``segment`` (n,) between gaps and resets."""

    name: str
    t: Array
    heading_deg: Array
    segment: NDArray[np.int64]
    text: str = ""
