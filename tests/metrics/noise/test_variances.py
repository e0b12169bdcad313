"""What is left of a row in windows: what scipy and numpy's least squares say of each, compiled and plain."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import detrend
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.kernels.loops import function_of
from attlog.metrics.noise import injection, variances, windows
from attlog.metrics.noise.injection import PUSHED, left_of_pushed
from attlog.metrics.noise.variances import AT_REST, left_at_rest

EDGES = np.array([0, 60, 140])
STEP = 0.01


def attitudes(shaken_rad, headings=(0.4, -2.0), seed=1):
    """Attitudes (140, 4) of two windows, tilted, about these headings; turned by small vectors in the earth."""
    rng = np.random.default_rng(seed)
    middle = Rotation.from_euler("ZYX", [(yaw, 0.1, -0.2) for yaw in np.repeat(headings, np.diff(EDGES))])
    q = (Rotation.from_rotvec(shaken_rad * rng.normal(size=(140, 3))) * middle).as_quat()
    return np.ascontiguousarray(np.roll(q, 1, axis=1))


def level(vectors, q):
    """Vectors (n, 3) seen along the headings of the windows' mean attitudes."""
    own = [Rotation.from_quat(np.roll(part, -1, axis=1)).mean() for part in np.split(q, EDGES[1:-1])]
    yaw = np.repeat([one.as_euler("ZYX")[0] for one in own], np.diff(EDGES))
    return Rotation.from_euler("Z", yaw[:, None]).inv().apply(vectors), own


@pytest.mark.parametrize("loop", [left_at_rest, function_of(AT_REST, left_at_rest)], ids=["plain", "compiled"])
def test_at_rest_the_rotation_from_the_windows_mean_is_left_without_its_line(loop):
    q, t = attitudes(0.004), 3.0 + STEP * np.arange(140)
    means = rotation.means(q, EDGES)
    out = np.empty((140, 3))
    loop(out, t, q, means, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES)
    _, own = level(np.zeros((140, 3)), q)
    pairs = zip(np.split(q, [60]), own, strict=True)
    apart = np.concatenate([(Rotation.from_quat(np.roll(p, -1, axis=1)) * m.inv()).as_rotvec() for p, m in pairs])
    wanted = np.concatenate([detrend(part, axis=0) for part in np.split(np.degrees(level(apart, q)[0]), [60])])
    np.testing.assert_allclose(out[:, :2], wanted[:, :2], atol=1e-9)
    np.testing.assert_allclose(out[:, 2], wanted[:, 2], atol=2e-3)  # the heading's angle, not the vector's part


def test_a_heading_that_turns_through_south_is_unwrapped_and_no_window_goes_on_from_the_one_before():
    t = STEP * np.arange(140)
    yaw = np.concatenate([np.linspace(-2.5, 2.5, 60) + np.pi, np.linspace(1.0, 1.1, 80)])
    wave = 0.01 * np.sin(9.0 * t)
    q = rotation.from_euler(0.0 * yaw, 0.0 * yaw, yaw + wave)
    means = rotation.means(q, EDGES)
    out = np.empty((140, 3))
    function_of(AT_REST, left_at_rest)(out, t, q, means, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES)
    wanted = np.concatenate([detrend(part) for part in np.split(np.degrees(wave), [60])])
    np.testing.assert_allclose(out[:, 2], wanted, atol=1e-9)


@pytest.mark.parametrize("loop", [left_of_pushed, function_of(PUSHED, left_of_pushed)], ids=["plain", "compiled"])
def test_in_flight_an_offset_and_a_constant_in_body_axes_are_fitted_by_least_squares(loop):
    q, t, pushed = attitudes(0.1), STEP * np.arange(140), attitudes(0.01, seed=2)
    centre, means, out = rotation.means(pushed, EDGES), rotation.means(q, EDGES), np.empty((140, 3))
    room = [np.empty((140, 9)), *([] if loop is not left_of_pushed else PUSHED.room())]
    loop(out, t, q, pushed, centre, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES, *room)
    left = []
    for k, (a, b) in enumerate([(0, 60), (60, 140)]):
        mean = Rotation.from_quat(np.roll(centre[k], -1))
        x = (Rotation.from_quat(np.roll(pushed[a:b], -1, axis=1)) * mean.inv()).as_rotvec()
        r = Rotation.from_quat(np.roll(q[a:b], -1, axis=1)).as_matrix()
        m = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(0.5 * STEP * (r[1:] + r[:-1]), axis=0)])
        columns = np.concatenate([np.tile(np.eye(3), (b - a, 1, 1)), m], axis=2).reshape(-1, 6)
        fit = columns @ np.linalg.lstsq(columns, x.ravel(), rcond=None)[0]
        left.append(np.degrees(x - fit.reshape(-1, 3)))
    np.testing.assert_allclose(out, level(np.concatenate(left), q)[0], atol=1e-9)


def test_windows_are_looked_at_some_at_a_time_and_none_is_lost(monkeypatch):
    monkeypatch.setattr(windows, "TOGETHER", 100)
    inside = [slice(0, 40), slice(50, 90), slice(90, 300), slice(310, 320)]
    found = list(windows.together(inside))
    assert [part for own, _, _ in found for part in own] == inside
    assert len(found) > 1
    for own, at, edges in found:
        assert [slice(at[a], at[b - 1] + 1) for a, b in pairwise(edges)] == own
    assert list(windows.together([])) == []


def test_the_loops_are_among_what_is_compiled_when_the_package_is_built():
    from attlog import prebuilt

    assert {variances.AT_REST.name, injection.PUSHED.name} <= {kernel.name for kernel in prebuilt.kernels()}
