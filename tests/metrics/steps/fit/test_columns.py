"""The compiled loops of the step fits: what simple numpy says of the same columns, and the same bits uncompiled."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.kernels import loops
from attlog.metrics.steps import events as steps
from attlog.metrics.steps.fit import aiding, sensors
from attlog.metrics.steps.fit import columns as step_columns
from attlog.metrics.steps.fit import groups as step_groups
from attlog.metrics.steps.fit.groups import MARGIN_S, STRIDE_S
from tests.metrics.motions import motion, sampled

KERNELS = (sensors.HELD, sensors.SEEN, aiding.SUMMED, step_columns.PRODUCTS, step_columns.POWERS)


def columns_of(row_hz, ref_hz):
    """The columns of some events; aiding as numbers that mean nothing."""
    t, q = motion("steps", 25.0)
    row, ref = sampled(t, q, row_hz, 0.004), sampled(t, q, ref_hz, offset=0.0013)
    groups = step_groups.groups(row, ref, steps.find(ref.t, ref.q, ref.segment), None)
    (found,) = groups.each()
    part = found.slow if found.slow_row else found.fast
    part.x[:, 1:] = np.cumsum(np.random.default_rng(2).standard_normal(part.x[:, 1:].shape), axis=0)
    return found


def slowly(found, delay, slope_s, aids):
    """Products and lines of each event, pair by pair with np.interp."""
    shift = -delay if found.slow_row else delay
    main = found.fast.x[:, 0] - (0.0 if found.slow_row else found.fast.x[:, 1:] @ aids)
    products, lines = [], []
    for event in range(len(found.fast.low)):
        rows = []
        for i, j in zip(found.begin[found.of == event], found.end[found.of == event], strict=True):
            a, b = found.slow.t[[i, j]] + shift
            if a - slope_s < found.fast.low[event] or b + slope_s > found.fast.high[event]:
                continue
            span = found.slow.t[j] - found.slow.t[i]
            moved = [(np.interp(b, found.fast.t, x) - np.interp(a, found.fast.t, x)) / span for x in found.fast.x.T]
            steep = [
                (np.interp(at + slope_s, found.fast.t, main) - np.interp(at - slope_s, found.fast.t, main))
                / 2
                / slope_s
                for at in (a, b)
            ]
            fixed = (found.slow.x[j] - found.slow.x[i]) / span
            est, ref = (fixed, moved) if found.slow_row else (moved, fixed)
            rows.append([est[0], (steep[1] - steep[0]) / span, *ref, *est[1:]])
        rows = np.array(rows)
        products.append((rows - rows.mean(axis=0)).T @ (rows - rows.mean(axis=0)))
        lines.append(len(rows))
    return np.array(products), np.array(lines)


@pytest.mark.parametrize(("row_hz", "ref_hz"), [(200.0, 50.0), (50.0, 200.0)])
@pytest.mark.parametrize("delay", [0.0061, -0.24])
def test_the_products_are_those_of_the_columns_built_pair_by_pair(row_hz, ref_hz, delay):
    found = columns_of(row_hz, ref_hz)
    assert found.slow_row == (row_hz < ref_hz)
    aids = np.linspace(0.1, 0.6, 6)
    products, lines = found.products(delay, 0.008, aids)
    wanted, counted = slowly(found, delay, 0.008, aids)
    np.testing.assert_array_equal(lines, counted)
    assert len(lines) > 3
    np.testing.assert_allclose(products, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(("row_hz", "ref_hz"), [(200.0, 50.0), (50.0, 200.0)])
def test_the_coarse_powers_are_those_of_rates_centred_per_event(row_hz, ref_hz):
    found = columns_of(row_hz, ref_hz)
    step = max(1, len(found.begin) // (step_columns.THINNED * len(found.fast.low)))
    begin, end, of = found.begin[::step], found.end[::step], found.of[::step]
    for delay in (-0.25, 0.0, 0.004):
        shift = -delay if found.slow_row else delay
        a, b = (np.interp(found.slow.t[k] + shift, found.fast.t, found.fast.x[:, 0]) for k in (begin, end))
        span = found.slow.t[end] - found.slow.t[begin]
        x, y = (b - a) / span, (found.slow.x[end, 0] - found.slow.x[begin, 0]) / span
        for v in (x, y):
            for event in np.unique(of):
                v[of == event] -= np.mean(v[of == event])
        xx, yy, xy = found.powers(np.array([delay]))[0]
        np.testing.assert_allclose([xx, yy, xy], [x @ x, y @ y, x @ y], rtol=1e-9)


def test_events_lie_so_far_apart_that_none_reaches_into_the_next():
    found = columns_of(200.0, 50.0)
    assert (found.fast.high[:-1] + 2 * MARGIN_S < found.fast.low[1:]).all()
    assert (np.diff(found.fast.low) > 0.9 * STRIDE_S).all()


def test_without_a_compiler_the_loops_give_the_same_bits(monkeypatch):
    found = columns_of(100.0, 25.0)
    compiled = found.products(0.003, 0.008, np.ones(6))[0], found.powers(np.array([0.0, 0.01]))
    monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    loops._loaded.cache_clear()
    try:
        plain = found.products(0.003, 0.008, np.ones(6))[0], found.powers(np.array([0.0, 0.01]))
    finally:
        loops._loaded.cache_clear()
    for a, b in zip(compiled, plain, strict=True):
        np.testing.assert_array_equal(a, b)


HOLDING = (sensors.held_field, loops.function_of(sensors.HELD, sensors.held_field))


@pytest.mark.parametrize("loop", HOLDING, ids=["plain", "compiled"])
def test_a_field_is_held_until_it_is_too_old_or_the_next_one_comes(loop):
    t, rate = 0.01 * np.arange(60), np.tile([0.5, -1.0, 2.0], (60, 1))
    new, m, age = np.array([3, 10, 40]), np.zeros((60, 3)), np.zeros(60)
    m[new] = np.eye(3)
    loop(m, age, t, rate, new, 0.155)
    source = np.repeat([-1, 3, 10, -1, 40, -1], [3, 7, 16, 14, 16, 4])
    for k in range(60):
        held = np.flatnonzero(new == source[k])
        old = (t[k] - t[new[held]]).sum()
        wanted = Rotation.from_rotvec(-rate[k] * old).apply(np.eye(3)[held].sum(axis=0))
        np.testing.assert_allclose(m[k], wanted, atol=1e-12)
        assert age[k] == pytest.approx(old)


def test_the_loops_are_among_what_is_compiled_when_the_package_is_built():
    from attlog import prebuilt

    assert {kernel.name for kernel in KERNELS} <= {kernel.name for kernel in prebuilt.kernels()}


@pytest.mark.parametrize(("low", "high", "lines"), [(-1.0, 2.0, 9), (0.25, 2.0, 6), (-1.0, 0.65, 6), (0.25, 0.65, 3)])
def test_pairs_that_reach_beyond_either_end_of_an_event_make_no_line(low: float, high: float, lines: int) -> None:
    """Ten samples 0.1 s apart, slopes over 0.02 s on both sides: those from 0.3 s on, those up to 0.6 s."""
    slow, fast = 0.1 * np.arange(10), 0.05 * np.arange(-20, 40)
    out, count = np.zeros((1, 12, 12)), np.zeros(1, np.int64)
    room = np.empty((10, step_columns.MOVED)), np.empty((9, step_columns.SIZE))
    turned, moved = np.tile(np.sin(slow)[:, None], (1, 7)), np.tile(np.sin(fast)[:, None], (1, 4))
    begin = np.arange(9)
    ends = np.array([low]), np.array([high])
    first = np.array([0, 9])
    step_columns.event_products(
        out, count, *room, slow, turned, fast, moved, moved[:, 0].copy(), *ends, begin, begin + 1, first, 0.0, 0.02, 1
    )
    assert count.tolist() == [lines]
