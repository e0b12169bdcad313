"""Types of a comparison: the aligned reference, attitude tracks, and their errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.core.spans import Span
from attlog.flight.model import Imu, TruthFit

Array = NDArray[np.float64]
# Name of the estimator that is run as reference.
SMOOTHER = "smoother"


class ReferenceOptions(NamedTuple):
    """Options to choose and align the reference.

    ``reference``: auto, truth, smoother, onboard, onboard:NAME or none. ``clock``: sample (times of measurement) or
    publication. ``declination``: auto, model, param or degrees. ``trim``: remove the vehicle's trim from replays.
    ``input_delay``: auto, off or ms. ``score_from``: start of scoring in s; None: 15 s after the first IMU sample.
    """

    reference: str = "auto"
    clock: str = "sample"
    declination: str | float = "auto"
    trim: bool = True
    input_delay: str | float = "auto"
    score_from: float | None = None


@dataclass(frozen=True, slots=True)
class AlignmentStep:
    """Decision in the alignment of attitudes, reported with value and source.

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
    """Reference interpolated to a row's times, reused by rows with equal times.

    ``own``: attitudes of the reference; ``of`` (n,): times of the row; ``number`` (n,): its segments between gaps;
    ``faster``: the row is sampled faster than the reference. At the k times of the slower one, ``known`` (k,) marks
    attitudes of the reference, ``good`` (k,) those of both. For the m good ones: ``t`` (m,) s, reference attitudes
    ``q`` (m, 4), and ``where`` (m,), the index of the reference sample before.
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
    __repr__ = brief


@dataclass(frozen=True, slots=True)
class SensorFault:
    """Fault of one sensor, shown by the others.

    ``why``: clause for messages; ``value``: its number in ``unit``; ``t``: first time, s; ``count``: occurrences.
    """

    why: str
    value: float | None = None
    unit: str = ""
    t: float | None = None
    count: int = 1
    # Whether a smoother with this sensor has a small sigma and a wrong attitude.
    misleads: bool = True


@dataclass(frozen=True, slots=True)
class GyroJump:
    """Step of the gyro bias at ``t`` s, with its one sigma."""

    t: float
    size_dps: tuple[float, float, float]
    sigma_dps: tuple[float, float, float]


@dataclass(slots=True)
class Alignment:
    """Alignment of the reference and of the rows compared with it.

    ``trim``: rotation vector (3,) in rad, removed from attitudes of the IMU. ``input_delay_s``: delay of the logged
    gyro, subtracted from lags. ``floor_deg``: smallest difference that the log resolves. ``step_deg``: quantisation
    step of the logged attitude.
    """

    clock: Literal["sample", "publication"] = "sample"
    trim: Array | None = None
    declination_deg: float | None = None
    input_delay_s: float = 0.0
    floor_deg: float = 0.0
    step_deg: float = 0.0
    steps: list[AlignmentStep] = field(default_factory=list)
    __repr__ = brief


@dataclass(slots=True)
class Scoring:
    """Scored time from ``start`` to ``end`` (s) without the ``unscored`` spans.

    ``end`` is an impact. ``refuted``: spans in which gravity at standstill contradicts a smoother.
    """

    start: float = 0.0
    end: float = np.inf
    unscored: list[Span] = field(default_factory=list)
    refuted: list[Span] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSigma:
    """One-sigma errors (n,) of a smoother or an external truth."""

    tilt_deg: Array
    heading_deg: Array
    __repr__ = brief


@dataclass(slots=True)
class HeadingOrigin:
    """Source of the reference's heading.

    ``own``: its own north. ``onboard``: heading of the onboard attitude. ``relative``: unknown north, only changes of
    heading are compared. ``none``: no heading is compared. ``why``: the reason.
    """

    by: Literal["own", "onboard", "relative", "none"] = "own"
    why: str = ""


@dataclass(slots=True)
class Faults:
    """Contradictions found by checks against physics, as sentences; empty without any.

    ``reference``: why agreement with the reference means nothing. ``doubt``: why the automatic choice would have
    refused a requested reference. ``refused``: reasons by refused attitude (truth, smoother, onboard). ``onboard``:
    error of the onboard attitude against the smoother. ``onboard_heading``: its heading error against GNSS
    acceleration. ``gyro``: why replays of the gyro cannot be judged. ``sensors``: faults of replayed sensors by name.
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
    """Reference attitude of a log, by ``kind`` of evidence.

    ``q`` (n, 4) at ``t`` (n,) s; ``gap_segment`` (n,) numbers the segments between gaps, ``segment`` (n,) those between
    gaps and resets. ``name``: an onboard attitude in the log. ``quality``: diagnostics reported by a smoother.
    ``gyro_jumps``: steps of the gyro bias found by a smoother, None if it does not search. ``fit``: fit of an external
    truth. ``second``: smoother to use if the onboard attitude is refused later.
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
    # Caches: fitted delay and sigma (s) of each gyro, and the samples at the times of the last row.
    delays: list[tuple[Imu, tuple[float, float] | None]] = field(default_factory=list, repr=False)
    samples: ReferenceSamples | None = field(default=None, repr=False, compare=False)
    __repr__ = brief


@dataclass(slots=True)
class AttitudeErrors:
    """Errors of a track against the reference, in deg.

    All (n,) at the times of the slower of both: the reference is never upsampled. ``heading`` is signed.
    ``gap_segment`` and ``segment`` as in :class:`Reference`. ``scored`` marks the samples that count.
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
    __repr__ = brief


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Agreement of a re-run onboard filter with the logged onboard attitude.

    Medians and 95 % quantiles of the difference over ``n`` records in ``seconds``, in the air where the log flew.
    ``start``: ``warm`` from logged states, ``cold`` from gravity. ``leaves_s``: first time apart, ``until_s``: first
    lane switch, after which another filter flew, both in s on the log's clock.
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
    until_s: float | None = None


@dataclass(slots=True, eq=False, weakref_slot=True)
class Track:
    """Aligned attitude over time: one row of the comparison.

    Compared by identity. ``name`` as in the result (``mahony@xu-0.6``, ``onboard``, ``onboard:AHR2``). ``t``, ``q``: at
    its own times with trim, declination and heading offset applied. ``segment`` (n,) counts restarts. ``start``: time
    of its first attitude. ``estimator``: key of :func:`attlog.estimators.get` (a name or a user's file), for onboard
    tracks the attitude's name in the log. ``kind``: ``replay`` of a filter, ``onboard``, or ``rerun`` of the onboard
    filter, which is never ranked. ``ns_per_update`` is None for onboard tracks. ``status``: ok, diverged,
    not_converged, not_judged, failed; ``reason``: a sentence for it.
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
    # Gyro bias (n, 3) rad/s subtracted from the logged gyro: the filter's estimate plus the common bias of all rows.
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
    # Equation declared in the filter's file; empty for a filter with an equation of its own.
    equation: str = ""
    # Whether the reference borrows its heading from this row, whose heading errors are then meaningless.
    heading_shared: bool = False
    # Heading offset removed from ``q`` (of its first segment); None where no offset was removed.
    heading_offset_deg: float | None = None
    # Alignment of this row alone: trim, heading offset.
    steps: list[AlignmentStep] = field(default_factory=list)
    # Replayed IMU; None for the default one of the log.
    imu: Imu | None = None
    # Diagnostics reported by an estimator that processes the whole run.
    quality: dict[str, float | str] = field(default_factory=dict)
    reproduction: Reproduction | None = None
    # Of a re-run: resets and aiding as ``flown``, or by the filter's ``own`` rules.
    mode: str = ""
    # Further outputs at every sample, (n,) or (n, k), by name.
    aux: dict[str, Array] = field(default_factory=dict)
    __repr__ = brief

    @property
    def knows_north(self) -> bool:
        """True if compass or GNSS motion gives an absolute heading."""
        return self.uses_mag or self.north_by_gnss

    def release(self) -> None:
        """Drop all arrays with a value for each sample."""
        self.t, self.q, self.segment = np.zeros(0), np.zeros((0, 4)), np.zeros(0, np.int64)
        self.bias = self.errors = None
        self.aux = {}


@dataclass(slots=True)
class HeadingReference:
    """Heading (n,) at ``t`` (n,) s by one source."""

    name: str
    t: Array
    heading_deg: Array
    segment: NDArray[np.int64]
    text: str = ""
    __repr__ = brief
