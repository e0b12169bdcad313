"""An attlog estimator in the loop: aids, cleaning of samples, and its attitude sample by sample."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation, timestamps
from attlog.core.errors import PluginError, UsageError
from attlog.core.jit import aligned_zeros
from attlog.core.jit.loops import Call
from attlog.core.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S
from attlog.estimators import Estimate, EstimatorSpec, LogFacts, LogInfo, parse, registry
from attlog.estimators.aids import (
    ALT,
    AT_REST,
    BARO,
    LAT,
    LON,
    POS_H_ACC,
    POS_V_ACC,
    SIZE,
    VEL_ACC,
    VEL_D,
    VEL_E,
    VEL_N,
    AidRows,
)
from attlog.estimators.interface import Estimator, plugin_errors
from attlog.estimators.run import SIGMAS, Samples, runner
from attlog.estimators.samples import HELD, HOLD_PERIODS, MISSING, NEW, Sampling
from attlog.estimators.start import (
    MOTION_S,
    REST_S,
    StartVectors,
    at_rest,
    declination_rad,
    first_seconds,
    initial_state,
    realigned,
)
from attlog.estimators.vectors import turn_vector_back

Array = NDArray[np.float64]


class Inbox:
    """Aids that arrived and wait for the first sample at or after their time.

    ``north`` rad: true north from the north of the steps. ``asks_rest``: whether the estimator uses rest.
    """

    def __init__(self, north: float, asks_rest: bool) -> None:
        self._north, self._asks_rest = north, asks_rest
        self._arrived: list[tuple[float, dict[int, float]]] = []
        self._resting = math.nan

    def gnss(
        self, t: float, position: ArrayLike | None, velocity: ArrayLike | None, sigma: tuple[float, float, float]
    ) -> None:
        """Add a fix with stamp ``t``: latitude, longitude (deg), altitude (m), velocity NED (m/s) from true north.

        ``sigma``: 1 sigma of horizontal and vertical position (m) and of the velocity (m/s).
        """
        reported: dict[int, float] = {}
        if position is not None:
            reported |= dict(zip((LAT, LON, ALT), np.asarray(position, np.float64).tolist(), strict=True))
            reported |= {POS_H_ACC: sigma[0], POS_V_ACC: sigma[1]}
        if velocity is not None:
            north, east, down = np.asarray(velocity, np.float64).tolist()
            # A step knows magnetic north only.
            c, s = math.cos(self._north), math.sin(self._north)
            reported |= {VEL_N: c * north + s * east, VEL_E: c * east - s * north, VEL_D: down, VEL_ACC: sigma[2]}
        self._arrived.append((t, reported))

    def baro(self, t: float, height: float) -> None:
        """Add a barometric height (m) with stamp ``t``."""
        self._arrived.append((t, {BARO: height}))

    def resting(self, rest: bool) -> None:
        """Add whether the vehicle rests (landed and disarmed)."""
        self._resting = 1.0 if rest else 0.0

    def due(self, t: float, begins: bool) -> Array:
        """Return the newest of each aid (2, SIZE) up to ``t``, as the shared loop hands it to a step.

        The first sample of a segment (``begins``) takes no step, so it gets none.
        """
        due = [reported for at, reported in self._arrived if at <= t]
        self._arrived = [(at, reported) for at, reported in self._arrived if at > t]
        aid = np.full((2, SIZE), np.nan)
        aid[:, AT_REST] = self._resting if self._asks_rest else math.nan
        for reported in due if not begins else ():
            for where, value in reported.items():
                if math.isfinite(value):
                    aid[1, where] = value
        return aid


@dataclass(slots=True)
class Sample:
    """One cleaned sample, as a row of :class:`attlog.estimators.samples.Samples`, with its aid or None.

    ``restart``: after a gap that nothing bridges, it begins a segment.
    """

    t: float
    dt: float
    substeps: int
    gyr: Array
    acc: Array
    mag: Array
    use: int
    aid: Array | None
    restart: bool = False


class Cleaner:
    """Cleaning of single samples by the rules of the shared loop.

    ``hold_mag``: a field serves until the next. ``aids``: source of a sample's aid, None without. ``skipped``:
    count by reason.
    """

    def __init__(
        self, imu_rate: float, mag_rate: float | None, *, hold_mag: bool, instant: bool, aids: Inbox | None
    ) -> None:
        self._gap = timestamps.gap_limit(1.0 / imu_rate)
        self._hold = HOLD_PERIODS / mag_rate if mag_rate and hold_mag else -1.0
        self._instant, self._aids = instant, aids
        self.skipped: Counter[str] = Counter()
        self._last_t: float | None = None
        self._raw_last = np.zeros(3)
        self._field_t = -math.inf

    def cleaned(self, t: float, gyr: Array, acc: Array, mag: Array | None, own: float) -> Sample | None:
        """Return the sample as :func:`attlog.estimators.samples.prepare` cleans it, None if it is left out."""
        last_t = self._last_t
        x, y, z = gyr.tolist()
        if not math.isfinite(t + x + y + z):
            self.skipped["nan"] += 1
            return None
        if max(abs(x), abs(y), abs(z)) > GYRO_LIMIT_RAD_S:
            self.skipped["saturated"] += 1
            return None
        if last_t is not None and t <= last_t:
            self.skipped["time_not_rising"] += 1
            return None
        gyr = np.array(gyr, np.float64)
        step = 0.0 if last_t is None else t - last_t
        restart = step > max(self._gap, timestamps.MAX_BRIDGED_GAP_S)
        if restart:
            self.skipped["restart"] += 1
            self._field_t = -math.inf
        begins = restart or last_t is None
        rate = gyr
        if not begins and (self._instant or step > self._gap):
            if step > self._gap:
                self.skipped["gap_bridged"] += 1
            rate = 0.5 * (self._raw_last + gyr)
        dt = 0.0 if begins else own if own > 0.0 and step < 1.5 * own else step
        angle = math.sqrt(float(rate @ rate)) * dt
        force = self._vector(acc, ACC_LIMIT_M_S2)
        field = np.zeros(3) if mag is None else self._vector(mag, math.inf)
        use = MISSING
        if mag is not None and field.any():
            use, self._field_t = NEW, t
        elif t - self._field_t <= self._hold:
            use = HELD
        self._last_t, self._raw_last = t, gyr
        aid = None if self._aids is None else self._aids.due(t, begins)
        return Sample(t, dt, 0 if begins else max(math.ceil(angle), 1), rate, force, field, use, aid, restart)

    def _vector(self, x: Array, limit: float) -> Array:
        """Return the vector, or zeros (counted) where it is not finite or impossible."""
        a, b, c = x.tolist()
        if not math.isfinite(a + b + c):
            self.skipped["nan"] += 1
        elif max(abs(a), abs(b), abs(c)) > limit:
            self.skipped["saturated"] += 1
        elif a == b == c == 0.0:
            self.skipped["zero_vector"] += 1
        else:
            return np.array(x, np.float64)
        return np.zeros(3)


# No estimator: the controller flies on the true attitude and rate.
TRUE_ATTITUDE = "truth"


def stepping_estimator(text: str) -> EstimatorSpec:
    """Return the estimator of ``NAME[@PRESET][:k=v,...]``. UsageError for one that cannot fly."""
    row = parse(text)
    if row.estimator.step is None:
        why = "looks at samples that a vehicle does not have yet" if not row.estimator.causal else "has no step"
        raise UsageError(
            f"{row.name} cannot fly: it runs over a whole log at once and {why}; "
            f"take a filter with a step, for example mahony, ekf12 or mekf, or {TRUE_ATTITUDE}"
        )
    return row


def _with_errors(estimator: Estimator, advance: Callable[..., Any]) -> Callable[..., Any]:
    """Return a filter's loop whose errors are PluginErrors with the file's name, as in a replay."""
    if estimator.origin == "attlog":
        return advance

    def guarded(*arguments: Any) -> Any:
        with plugin_errors(estimator.origin):
            return advance(*arguments)

    return guarded


class _One:
    """Arguments of the compiled loop for one sample: arrays bound once."""

    def __init__(self) -> None:
        rate, force, field = np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3))
        self.samples = Samples(np.zeros(1), np.zeros(1, np.int64), rate, force, field, np.array([NEW]))
        self.aids = AidRows(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros((2, SIZE)))


class Live:
    """Attitude of one estimator while a vehicle flies, with the numbers of a batch run.

    The shared loop (:mod:`attlog.estimators.run`) has a whole log, a vehicle one sample after the other. Every rule
    of that loop is kept around the same compiled step: bad samples, gaps, the sampling rule, the time to which
    vectors belong, the slow magnetometer's vector turned on by the gyro, aids at the first sample at or after their
    time, a late field, and the start. A start needs the first seconds: there is no attitude before; then the
    samples waiting are run at once.

    Differences: of two samples with one time the loop may take the later; gap limit and age of a field use the
    nominal rate instead of the median; a step of more than 1 rad turns a held field with the bias after it.

    ``q`` (4,): body to true north, None until the start is over. ``bias`` (3,) rad/s. ``aids`` takes fixes, heights
    and rest. UsageError for an estimator without a step or without a sensor that it needs.
    """

    def __init__(
        self,
        estimator: str | EstimatorSpec,
        imu_rate: float,
        mag_rate: float | None,
        *,
        sampling: Sampling = "interval",
        declination: float | None = None,
    ) -> None:
        row = stepping_estimator(estimator) if isinstance(estimator, str) else estimator
        if row.estimator.process is not None:
            row = replace(row, estimator=registry.load_here(row.estimator.process.name))
        self.row, filter_ = row, row.estimator
        if mag_rate is None and "mag" in filter_.needs:
            raise UsageError(f"{self.row.name} needs a magnetometer, which this vehicle does not have")
        given = dict(self.row.params)
        if declination is not None and any(p.name == "declination" for p in filter_.parameters):
            given.setdefault("declination", declination)
        facts = LogFacts(info=LogInfo(declination_deg=declination, imu_rate_hz=imu_rate, mag_rate_hz=mag_rate))
        self.values = {k: v for k, (v, _) in filter_.resolve(self.row.preset, given, log=facts).items()}
        self._params = filter_.pack(self.values)
        self._run = runner(filter_)
        self._north = declination_rad(self.values)
        self._turn = (math.cos(0.5 * self._north), math.sin(0.5 * self._north))
        self.aids = Inbox(self._north, "at_rest" in filter_.uses)
        self._cleaner = Cleaner(
            imu_rate,
            mag_rate,
            hold_mag=filter_.hold_mag,
            instant=sampling == "instant",
            aids=self.aids if filter_.aided else None,
        )
        self.skipped = self._cleaner.skipped
        self._field_expected = mag_rate is not None
        bias = filter_.slices.get("bias")
        self._bias_at = None if bias is None else bias.start
        self.q: Array | None = None
        self.bias = np.zeros(3)
        self._waiting: list[Sample] = []
        self._segment = 0
        self._state: Array | None = None
        self._silent = False
        self._no_heading: list[tuple[float, float]] = []
        self._m = [0.0, 0.0, 0.0]
        self._out = np.empty((1, filter_.outputs))
        self._one = _One()
        self._kept: list[tuple[float, int, Array]] = []

    def sample(self, t: float, gyr: Array, acc: Array, mag: Array | None = None, dt: float = math.nan) -> None:
        """Take one IMU sample: ``gyr`` (3,) rad/s, ``acc`` (3,) m/s^2, ``mag`` (3,) if a field came.

        ``dt`` s: the sample's own time of integration where it is known.
        """
        cleaned = self._cleaner.cleaned(t, gyr, acc, mag, dt)
        if cleaned is None:
            return
        if cleaned.restart:
            self._restart()
        if self._state is None:
            self._waiting.append(cleaned)
            seen = self._seen()
            if seen is None:
                return
            queue, self._waiting = self._waiting, []
            self._begin(queue[0], seen)
        else:
            queue = [cleaned]
        for one in queue:
            self._step(one)
        state = self._state
        assert state is not None
        w, x, y, z = state[:4].tolist()
        c, s = self._turn
        self.q = np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
        if self._bias_at is not None:
            self.bias = state[self._bias_at : self._bias_at + 3].copy()

    def estimate(self) -> Estimate:
        """Return the outputs so far, as a batch run would."""
        filter_ = self.row.estimator
        out = np.array([x for _, _, x in self._kept]).reshape(-1, filter_.outputs)
        parts = {name: out[:, part.start if name in SIGMAS else part].copy() for name, part in filter_.slices.items()}
        q = np.ascontiguousarray(out[:, :4])
        return Estimate(
            t=np.array([t for t, _, _ in self._kept]),
            q=rotation.turn_about_down(q, self._north) if self._north else q,
            bias=parts.pop("bias", None),
            aux=parts,
            segment=np.array([s for _, s, _ in self._kept], np.int64),
            skipped=dict(self.skipped),
            causal=filter_.causal,
            no_heading=list(self._no_heading),
        )

    def _restart(self) -> None:
        """Begin a new segment: the filter starts anew."""
        self._segment += 1
        self._state, self._waiting, self._silent = None, [], False

    def _seen(self) -> StartVectors | None:
        """Return what the start needs, once more samples would not change it."""
        queue = self._waiting
        elapsed = queue[-1].t - queue[0].t
        if elapsed <= REST_S:
            return None
        if elapsed <= MOTION_S and not self._settled(queue):
            return None
        t, dt = np.array([s.t for s in queue]), np.array([s.dt for s in queue])
        gyr, acc, mag = (np.array([getattr(s, name) for s in queue]) for name in ("gyr", "acc", "mag"))
        return first_seconds(t, gyr, acc, mag, dt, str(self.values.get("init", "average")))

    def _settled(self, queue: list[Sample]) -> bool:
        """Return whether the start is complete: at rest, half a second of every vector."""
        soon = [s for s in queue if s.t - queue[0].t <= REST_S]
        if not at_rest(np.array([s.gyr for s in soon]), np.array([s.acc for s in soon])):
            return False
        wanted = ["acc", "mag"] if self._field_expected else ["acc"]
        came = [next((s.t for s in queue if getattr(s, name).any()), math.inf) for name in wanted]
        return queue[-1].t - max(came) > REST_S

    def _begin(self, begin: Sample, seen: StartVectors) -> None:
        """Set the state at the first sample of a segment."""
        filter_, one = self.row.estimator, self._one
        state = initial_state(filter_, seen, self._params, self.values, None)
        values = (state, self._params, one.samples, one.aids, 1, self._out, aligned_zeros(3), aligned_zeros(3))
        bound = self._run.bound(*values) if isinstance(self._run, Call) else functools.partial(self._run, *values)
        self._advance = _with_errors(filter_, bound)
        self._state = state
        uses = "mag" in filter_.uses
        self._silent = uses and self._field_expected and not seen.mag.any()
        self._m = [0.0, 0.0, 0.0]
        self._begun, self._late = begin.t, 0
        self._before = Sample(begin.t, 0.0, 1, np.zeros(3), np.zeros(3), np.zeros(3), MISSING, None)

    def _step(self, s: Sample) -> None:
        """Run one step of the kernel, with the vectors that belong to it."""
        state = self._state
        assert state is not None
        at_start = self.row.estimator.vectors_at == "start"
        # What a step compares with the attitude that it is given are the vectors of the sample before.
        source = self._before if at_start else s
        # The first sample of a segment takes no step; its own vectors are not taken either.
        if self._silent or source.use == MISSING or (not at_start and s.substeps == 0):
            self._m = [0.0, 0.0, 0.0]
        elif source.use == NEW:
            self._m = source.mag.tolist()
        else:
            self._turn_field(source, 1)
        one, aids = self._one.samples, self._one.aids
        one.dt[0], one.substeps[0], one.gyr[0], one.acc[0], one.mag[0] = s.dt, s.substeps, s.gyr, source.acc, self._m
        if s.aid is not None:
            aids.row[0], aids.table[:] = np.isfinite(s.aid[1, :AT_REST]).any(), s.aid
        self._advance()
        if self.row.estimator.origin != "attlog" and not 0.0 < float(state[:4] @ state[:4]) < math.inf:
            raise PluginError(f"{self.row.estimator.origin}: cannot fly: gives {state[:4]} as attitude at {s.t:.2f} s")
        if at_start and s.substeps > 1:
            self._turn_field(s, s.substeps - 1)
        if self._silent and s.use == NEW:
            self._no_heading.append((self._begun, s.t))
            state[:] = realigned(self.row.estimator, state, self._params, s.mag)
            self._out[0] = state[: self.row.estimator.outputs]
            self._silent = False
            self._m = [0.0, 0.0, 0.0]
            self.skipped["late_field"] += self._late
        self._late += 1
        self._before = s
        self._kept.append((s.t, self._segment, self._out[0].copy()))

    def _turn_field(self, s: Sample, times: int) -> None:
        """Turn the last field on by the bias-corrected rate of a sample."""
        state, at = self._state, self._bias_at
        assert state is not None
        x, y, z = (s.gyr if at is None else s.gyr - state[at : at + 3]).tolist()
        for _ in range(times):
            turn_vector_back(self._m, x, y, z, s.dt / max(s.substeps, 1))
