"""Xu run again: numbers by another way, verdicts that follow the numbers, logs that cannot tell."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.reproduce import xu
from attlog.reproduce.paper import Paper, PaperOptions
from attlog.reproduce.xu import ADAPTIVE, ROWS, SWEPT, Flights, GainRun, best_gain, gain, oscillation_on_log
from attlog.testing import flight
from attlog.testing.motions import total_deg
from tests.conftest import SAMPLES

SEEDS = 2
LOGS = (SAMPLES / "px4_hover.ulg", SAMPLES / "copter_steps_stabilize.bin")


@pytest.fixture(scope="module", autouse=True)
def two_legs() -> Iterator[None]:
    """Two waypoints in place of five, flown once per seed: the whole mission takes seconds each time."""
    whole = xu.mission()
    legs = whole.command[:4]
    land = replace(whole.command[-1], t=legs[-1].t + 13.0)
    short = whole.changed(seconds=land.t + 2.0, command=(*legs, land))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xu, "mission", lambda: short)
        once = functools.cache(xu.flown)
        patch.setattr(xu, "flown", once)
        patch.setattr(xu, "flown", once)
        yield


@pytest.fixture(scope="module")
def seeds(two_legs: None) -> list[GainRun]:
    return [xu.one_seed(seed) for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def found(seeds: list[GainRun]) -> Paper:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xu, "run_seeds", lambda *_: seeds)
        return xu.paper(PaperOptions(seeds=SEEDS, logs=LOGS))


@pytest.mark.slow
def test_the_error_of_tilt_is_that_of_a_run_by_hand(seeds: list[GainRun]) -> None:
    s = xu.flown(0)
    q = attlog.estimate("mahony@xu-1.1", s.t, s.gyr, s.acc, s.mag, dt=s.dt, declination=s.declination_deg).q
    down = rotation.rotate_inverse(q, np.array([0.0, 0.0, 1.0]))
    true = rotation.rotate_inverse(s.q, np.array([0.0, 0.0, 1.0]))
    angle = np.degrees(np.arccos(np.clip(np.sum(down * true, axis=1), -1.0, 1.0)))[xu.in_the_air(s.t)]
    assert seeds[0].tilt[gain(1.1)] == pytest.approx(np.sqrt(np.mean(angle**2)), rel=1e-6)


@pytest.mark.slow
def test_the_frequency_of_zero_crossings_is_that_of_counted_ones(seeds: list[GainRun]) -> None:
    """Of the error of roll, its frequencies beyond the band taken out."""
    s = xu.flown(0)
    found = xu.run_filter(gain(2.0), s)
    part = xu.in_the_air(found.t)
    error = found.errors[part, 0] - found.errors[part, 0].mean()
    f = np.fft.rfftfreq(len(error), 0.005)
    within = np.fft.irfft(np.where((f >= 0.2) & (f < 5.0), np.fft.rfft(error), 0.0), len(error))
    counted = np.sum((within[:-1] < 0.0) & (within[1:] >= 0.0)) / (len(error) * 0.005)
    assert seeds[0].crossing[gain(2.0)][0] == pytest.approx(counted, rel=0.25)


@pytest.mark.slow
def test_slow_errors_are_what_an_average_over_five_seconds_leaves(seeds: list[GainRun]) -> None:
    s = xu.flown(0)
    found = xu.run_filter(gain(0.06), s)
    error = found.errors[xu.in_the_air(found.t), :2]
    means = np.column_stack([np.convolve(error[:, axis], np.full(1000, 1e-3), "valid") for axis in (0, 1)])
    assert seeds[0].slow[gain(0.06)] == pytest.approx(np.sqrt(np.mean(np.sum(means**2, axis=1))), rel=1e-3)


def test_the_matrix_form_of_the_cost_is_the_filter_of_the_paper() -> None:
    """Both forms give one attitude, so that the same work is timed."""
    m = flight(10.0, 200.0)
    quaternion, matrix = (attlog.estimate(row, *m.sensors).q for row in xu.COSTED)
    assert total_deg(quaternion, matrix).max() < 0.1
    spent = dict(zip(xu.COSTED, ([40.0, 41.0, 40.0], [60.0, 61.0, 61.0]), strict=True))
    assert xu.cost_claim(spent).verdict == "holds"
    assert xu.cost_claim(dict(zip(xu.COSTED, reversed(list(spent.values())), strict=True))).verdict != "holds"


@pytest.mark.slow
def test_the_verdicts_follow_the_numbers(seeds: list[GainRun]) -> None:
    assert xu._oscillation_claim([Flights("simulated missions", seeds)]).verdict == "holds in part"
    swap = {gain(0.6): gain(2.0), gain(2.0): gain(0.6)}
    turned = [replace(s, crossing={row: s.crossing[swap.get(row, row)] for row in ROWS}) for s in seeds]
    assert xu._oscillation_claim([Flights("simulated missions", turned)]).verdict == "does not hold"
    grown = {gain(kp): kp for kp in SWEPT} | {ADAPTIVE: 1.0}
    by_seed = [{row: (hz * (1.0 + 0.01 * k),) * 3 for row, hz in grown.items()} for k in range(SEEDS)]
    faster = [replace(s, crossing=hz, hz=hz) for s, hz in zip(seeds, by_seed, strict=True)]
    assert xu._oscillation_claim([Flights("simulated missions", faster)]).verdict == "holds"
    slower = [replace(s, slow={row: 1.0 + 0.01 * k for row in ROWS} | {gain(0.03): 2.0}) for k, s in enumerate(seeds)]
    assert xu.slow_claim(Flights("simulated missions", slower)).verdict == "holds"
    flat = [replace(s, slow=s.slow | {gain(0.06): 2.0, gain(0.03): 1.0 + 0.01 * k}) for k, s in enumerate(seeds)]
    assert xu.slow_claim(Flights("simulated missions", flat)).verdict == "does not hold"
    better = [replace(s, tilt=s.tilt | {ADAPTIVE: 0.5 * s.tilt[gain(0.6)]}) for s in seeds]
    better = [replace(s, rms=s.rms | {ADAPTIVE: tuple(0.5 * v for v in s.rms[gain(0.6)])}) for s in better]
    assert xu._adaptive_claim([Flights("simulated missions", better)]).verdict == "holds"


@pytest.mark.slow
def test_the_best_gain_is_the_lowest_of_a_curve_that_is_known(seeds: list[GainRun]) -> None:
    curve = {gain(kp): 1.0 + np.log(kp / 0.85) ** 2 for kp in SWEPT}
    known = [
        replace(s, tilt={**s.tilt, **{k: v * (1 + 0.01 * n) for k, v in curve.items()}}) for n, s in enumerate(seeds)
    ]
    runs = Flights("simulated missions", known)
    best = best_gain(runs, "tilt")
    assert (best.kp, best.alike) == (0.85, (0.85,))
    assert best.over.value == pytest.approx(1.0 + np.log(0.6 / 0.85) ** 2)


@pytest.mark.parametrize(
    ("best_kp", "at_least", "at_most"),
    [(0.1, "does not hold", "holds"), (0.85, "holds", "holds"), (3.0, "holds", "does not hold")],
)
def test_each_end_of_the_range_of_the_best_gain_has_a_verdict(best_kp: float, at_least: str, at_most: str) -> None:
    error = {gain(kp): 1.0 + np.log(kp / best_kp) ** 2 for kp in SWEPT}
    scaled = [{row: e * (1.0 + 0.01 * n) for row, e in error.items()} for n in range(3)]
    runs = [GainRun(tilt=one, heading=one) for one in scaled]
    low, high = xu._best_gain_claims([Flights("simulated missions", runs)])
    assert (low.verdict, high.verdict) == (at_least, at_most)


@pytest.mark.slow
def test_logs_are_measured_and_named(found: Paper) -> None:
    assert found.logs == tuple(path.name for path in LOGS)
    names = [n.what for c in found.claims for n in c.numbers]
    assert sum("logs" in name for name in names) >= 10
    assert sum("simulated missions" in name for name in names) >= 10


def test_what_a_log_shows_is_what_the_filter_pushes_in(tmp_path: Path) -> None:
    """The gyro alone pushes nothing in, a larger gain pushes more."""
    one = oscillation_on_log(LOGS[0], ("gyro", "mahony@xu-0.6", "mahony@xu-2"))
    assert not one.why_not
    assert max(one.rms["gyro"]) < 1e-9
    assert all(a < b for a, b in zip(one.rms["mahony@xu-0.6"], one.rms["mahony@xu-2"], strict=True))
    assert one.reference == "truth"


def test_a_log_that_cannot_tell_says_why(tmp_path: Path) -> None:
    path = tmp_path / "bad.bin"
    path.write_bytes(b"\0" * 5000)
    assert oscillation_on_log(path, ("mahony@xu-0.6",)).why_not
    found = xu._notes([oscillation_on_log(path, ("mahony@xu-0.6",))])
    assert any("bad.bin" in note for note in found)


@pytest.mark.slow
def test_every_figure_has_lines_with_numbers(found: Paper) -> None:
    for figure in found.figures:
        assert figure.lines
        for line in figure.lines:
            assert np.isfinite(np.asarray(line.y)).all()


def test_a_single_log_has_no_interval_and_no_say_in_a_verdict() -> None:
    seeds, one, two = (SimpleNamespace(called=name, runs=[None] * n) for name, n in (("s", 1), ("one", 1), ("two", 2)))
    parts: Any = {"s": ["holds"], "one": ["does not hold"], "two": ["does not hold"]}
    assert [xu._verdict([seeds, other], parts) for other in (one, two)] == ["holds", "holds in part"]  # type: ignore[list-item]
