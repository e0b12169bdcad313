"""Experiments shared by the papers: seeds in processes, filters over simulated samples, responses, spectra, cost."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.core.sorting import median
from attlog.core.workers import Died, in_processes
from attlog.estimators.samples import Sampling
from attlog.reproduce.paper import PaperOptions
from attlog.simulate.scenario import EstimatorChoice

if TYPE_CHECKING:
    from attlog.simulate.flight import Flight


Outcome = TypeVar("Outcome")
STAGES = logging.getLogger("attlog.stages")


def run_seeds(what: str, experiment: Callable[..., Outcome], options: PaperOptions, *arguments: Any) -> list[Outcome]:
    """Return ``experiment(seed, *arguments)`` for seeds 0, 1, ... in their order.

    ``experiment`` is a function of a module and its result pickles; ``what``: text of the progress. AttlogError if
    a process dies.
    """
    return run_each(what, experiment, [(seed, *arguments) for seed in range(options.seeds)], options)


def run_each(
    what: str, experiment: Callable[..., Outcome], work: Sequence[tuple[Any, ...]], options: PaperOptions
) -> list[Outcome]:
    """Return ``experiment(*arguments)`` for each of ``work``, in its order."""
    if options.processes <= 1 or len(work) <= 1:
        found: dict[int, Outcome] = {}
        for k, arguments in enumerate(work):
            STAGES.info("%s, %d of %d", what, k + 1, len(work))
            found[k] = experiment(*arguments)
        return list(found.values())
    found = {}
    for k, result in in_processes(experiment, dict(enumerate(work)), options.processes):
        if isinstance(result, Died):
            raise AttlogError(f"{what}, number {k}: {result}")
        found[k] = result
        STAGES.info("%s, %d of %d", what, len(found), len(work))
    return [found[k] for k in range(len(work))]


Array = NDArray[np.float64]
AXES = ("roll", "pitch", "heading")
# Bench flights use the true attitude; filters run over the samples afterwards.
FLOWN_ON_TRUTH = EstimatorChoice("truth")


@dataclass(frozen=True, slots=True)
class FlightSamples:
    """Input of a filter: ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` T (n, 3) at ``t`` (n,) s, and the truth ``q`` (n, 4).

    Rows of ``mag`` are NaN without a new field. Heading counts from true north, the field is ``declination_deg``
    east of it.
    """

    t: Array
    gyr: Array
    acc: Array
    mag: Array | None
    dt: Array
    sampling: Sampling
    q: Array
    declination_deg: float


@dataclass(frozen=True, slots=True)
class FilterOutput:
    """Attitudes of a filter: ``q`` (n, 4) at ``t`` (n,) s and ``truth`` (n, 4) at the same times."""

    t: Array
    q: Array
    truth: Array

    @property
    def angles(self) -> Array:
        """Return roll, pitch, heading (n, 3) in deg, heading without jumps."""
        return angles(self.q)

    @property
    def errors(self) -> Array:
        """Return errors of roll, pitch and heading (n, 3) in deg, within 180 deg."""
        return np.asarray(np.degrees(rotation.wrap(rotation.to_euler(self.q) - rotation.to_euler(self.truth))))

    @property
    def tilt_error(self) -> Array:
        """Return the angle (n,) in deg between true and estimated vertical."""
        return np.asarray(np.degrees(rotation.tilt_angle(rotation.earth_error(self.q, self.truth))))

    @property
    def heading_error(self) -> Array:
        """Return the error (n,) in deg about the vertical."""
        return np.asarray(np.degrees(rotation.heading_angle(rotation.earth_error(self.q, self.truth))))


def flight_samples(flight: Flight, *, mag: bool = True) -> FlightSamples:
    """Return the first IMU of a flight, with the first magnetometer at its times unless ``mag`` is False."""
    imu = flight.imus[0]
    t = imu.t_sample
    field = None
    if mag and flight.mags:
        field = estimators.place(t, flight.mags[0].t_sample, flight.mags[0].field)
    q = rotation.slerp(flight.truth.t, flight.truth.q, np.minimum(t, flight.truth.t[-1]))
    return FlightSamples(t, imu.gyro, imu.acc, field, imu.dt, imu.sampling, q, flight.declination_deg)


def run_filter(row: str, s: FlightSamples, q0: Array | None = None) -> FilterOutput:
    """Run a filter (``mahony@xu-0.6``) over the samples, from its own start or from ``q0`` (4,)."""
    found = estimators.estimate(
        row,
        s.t,
        s.gyr,
        s.acc,
        s.mag,
        sampling=s.sampling,
        dt=s.dt,
        q0=q0,
        declination=s.declination_deg,
        check_units=False,
    )
    return FilterOutput(found.t, found.q, s.q[np.searchsorted(s.t, found.t)])


def gravity_error(s: FlightSamples, found: FilterOutput) -> Array:
    """Return |e| (n,): the sine of the angle between measured and estimated gravity (Lyu 13-15)."""
    acc = s.acc[np.searchsorted(s.t, found.t)]
    seen = -acc / np.linalg.norm(acc, axis=1, keepdims=True)
    expected = rotation.rotate_inverse(found.q, np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.linalg.norm(np.cross(seen, expected), axis=1))


def angles(q: Array) -> Array:
    """Return roll, pitch, heading (n, 3) in deg of attitudes (n, 4), heading without jumps."""
    found = np.array(rotation.to_euler(q))
    found[:, 2] = np.unwrap(found[:, 2])
    return np.asarray(np.degrees(found))


def rms(x: Array) -> float:
    """Return the root of the mean square of finite values."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def settling_s(t: Array, error: Array, since: float, within: float) -> float:
    """Return seconds from ``since`` until |error| (n,) stays ``within`` for good; NaN if it never does."""
    late = t >= since
    beyond = np.flatnonzero(late & ~(np.abs(error) <= within))
    if not late.any() or (len(beyond) and beyond[-1] == len(t) - 1):
        return float("nan")
    return float(t[beyond[-1] + 1] - since) if len(beyond) else 0.0


def overshoot_of(t: Array, y: Array, since: float, begin: float, end: float) -> float:
    """Return how far ``y`` (n,) passes ``end`` after ``since``, coming from ``begin``."""
    beyond = (y[t >= since] - end) * np.sign(end - begin)
    return max(0.0, float(np.nanmax(beyond))) if len(beyond) else float("nan")


def crossing_s(t: Array, y: Array, since: float, begin: float, end: float, share: float) -> float:
    """Return when ``y`` (n,) first is at ``share`` of the way from ``begin`` to ``end``; NaN if never."""
    gone = (y - begin) / (end - begin)
    hit = np.flatnonzero((t >= since) & (gone >= share))
    if not len(hit):
        return float("nan")
    k = int(hit[0])
    if k == 0 or not gone[k] > gone[k - 1]:
        return float(t[k])
    return float(t[k] - (t[k] - t[k - 1]) * min(1.0, (gone[k] - share) / (gone[k] - gone[k - 1])))


def rise_s(t: Array, y: Array, since: float, begin: float, end: float) -> float:
    """Return seconds from 10 to 90 % of the way from ``begin`` to ``end``; NaN if never."""
    return crossing_s(t, y, since, begin, end, 0.9) - crossing_s(t, y, since, begin, end, 0.1)


def quick_errors(t: Array, error: Array, within_s: float = 2.0, step_s: float = 0.04) -> tuple[Array, Array]:
    """Return the distance of an error (n, k) from its running median, every ``step_s``.

    Median over ``within_s``. Times (m,) and distances (m, k); half a window at both ends is left out.
    """
    every = max(1, round(step_s * (len(t) - 1) / float(t[-1] - t[0])))
    t, error = t[::every], error[::every]
    half = max(1, round(0.5 * within_s / float(median(np.diff(t)))))
    windows = np.lib.stride_tricks.sliding_window_view(error, 2 * half + 1, axis=0)
    return t[half : len(t) - half], error[half : len(t) - half] - median(windows, axis=-1)


def count_spikes(t: Array, error: Array, threshold: float, apart_s: float = 0.5) -> tuple[int, float]:
    """Return the number of times |error| (n,) exceeds a threshold, and its peak.

    Excursions less than ``apart_s`` apart count once.
    """
    over = np.flatnonzero(np.abs(error) > threshold)
    count = 0 if not len(over) else 1 + int(np.sum(np.diff(t[over]) > apart_s))
    return count, float(np.nanmax(np.abs(error)))


def detrended_std(t: Array, y: Array) -> float:
    """Return the standard deviation of ``y`` (n,) about its straight line."""
    line = np.polynomial.Polynomial.fit(t, y, 1)
    return float(np.std(y - line(t), ddof=2))


SPECTRUM_WINDOW_S = 10.0
# Fewest samples of a window.
MIN_WINDOW_SAMPLES = 8


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power ``density`` (m,) in unit^2/Hz at frequencies ``f`` (m,) Hz."""

    f: Array
    density: Array

    def rms(self, band: tuple[float, float]) -> float:
        """Return the RMS between two frequencies (Hz, the first included)."""
        return math.sqrt(float(np.sum(self.density[self._inside(band)])) * float(self.f[1]))

    def dominant_hz(self, band: tuple[float, float]) -> float:
        """Return the frequency of the band with most power per octave (f times density)."""
        inside = np.flatnonzero(self._inside(band))
        return float(self.f[inside[np.argmax(self.f[inside] * self.density[inside])]])

    def crossing_hz(self, band: tuple[float, float]) -> float:
        """Return upward zero crossings per second of the part in the band.

        The root of the mean of f^2, weighted by power (Rice 1944).
        """
        inside = self._inside(band)
        power = self.density[inside]
        return math.sqrt(float(np.sum(self.f[inside] ** 2 * power)) / float(np.sum(power)))

    def _inside(self, band: tuple[float, float]) -> NDArray[np.bool_]:
        return (self.f >= band[0]) & (self.f < band[1])


def spectrum(t: Array, y: Array, window_s: float = SPECTRUM_WINDOW_S) -> Spectrum:
    """Return the spectrum of ``y`` (n,) at even times ``t`` (n,) s.

    Welch's method (1967): windows of 10 s that overlap by half, each without its straight line, tapered by Hann's
    window; a shorter signal is one window. ValueError for less than 8 samples.
    """
    if len(t) < MIN_WINDOW_SAMPLES:
        raise ValueError(f"{len(t)} samples are too few for a spectrum")
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    size = min(len(t), max(MIN_WINDOW_SAMPLES, round(window_s / dt)))
    return spectrum_of_windows(dt, [y[k : k + size] for k in range(0, len(t) - size + 1, max(1, size // 2))])


def spectrum_of_windows(dt: float, windows: Sequence[Array]) -> Spectrum:
    """Return the mean spectrum of windows (n,) of one length, samples ``dt`` s apart."""
    size = len(windows[0])
    taper = np.hanning(size + 1)[:-1]
    line = np.vander(np.arange(size) - 0.5 * (size - 1), 2)
    power = []
    for part in windows:
        flat = part - line @ np.linalg.lstsq(line, part, rcond=None)[0]
        power.append(np.abs(np.fft.rfft(flat * taper)) ** 2)
    density = np.mean(power, axis=0) * 2.0 * dt / float(taper @ taper)
    density[0] *= 0.5
    if size % 2 == 0:
        density[-1] *= 0.5
    return Spectrum(np.asarray(np.fft.rfftfreq(size, dt), np.float64), np.asarray(density, np.float64))


COST_ROUNDS, COST_UPDATES, COST_REPEATS, COST_RATE_HZ = 9, 4000, 7, 400.0
COST_METHOD = f"Processor time of {COST_UPDATES:,} updates, compiled alike, {COST_ROUNDS} runs in turn."


@dataclass(frozen=True, slots=True)
class CostSamples:
    """A slow swing in noise: ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` uT (n, 3) at ``t`` (n,) s."""

    t: Array
    gyr: Array
    acc: Array
    mag: Array


def cost_samples(updates: int = COST_UPDATES) -> CostSamples:
    """Return the samples that every filter is timed with."""
    rng = np.random.default_rng(0)
    t = np.arange(updates) / COST_RATE_HZ
    turn = np.sin(np.outer(t, [1.0, 1.3, 0.7]))
    acc = np.array([0.0, 0.0, -9.81]) + turn + 0.05 * rng.standard_normal(turn.shape)
    return CostSamples(t, 0.3 * turn, acc, np.array([20.0, 0.0, 40.0]) + turn)


def time_updates(
    rows: Sequence[str],
    every: int | None = 1,
    rounds: int = COST_ROUNDS,
    updates: int = COST_UPDATES,
    repeats: int = COST_REPEATS,
) -> dict[str, list[float]]:
    """Return nanoseconds per update of each filter, ``rounds`` times in turn.

    ``every``: updates per new field, None: never. Of ``repeats`` runs of a round the fastest counts: the others
    were interrupted.
    """
    s = cost_samples(updates)
    mag = None
    if every is not None:
        mag = s.mag.copy()
        mag[np.arange(updates) % every != 0] = np.nan
    found: dict[str, list[float]] = {row: [] for row in rows}
    for _ in range(rounds):
        for row, spent in found.items():
            times = [
                estimators.estimate(row, s.t, s.gyr, s.acc, mag, check_units=False).ns_per_update
                for _ in range(repeats)
            ]
            spent.append(min(times))
    return found
