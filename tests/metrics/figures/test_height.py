"""The height over a flight is that over the ground it stood on, though its barometer drifts."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.flight.model import Stream
from attlog.metrics.figures.height import averaged, ground
from attlog.report.first_screen.strip import strip

T = np.arange(0.0, 200.0, 0.1)
FLIGHT = (50.0, 150.0)


def test_a_drift_of_the_barometer_is_no_height() -> None:
    true = 8.0 * ((T > FLIGHT[0] + 1) & (T < FLIGHT[1] - 1))
    x = 100.0 + 0.02 * T + true
    above = x - ground(Stream(T, x[:, None], "m", "", "BARO"), [FLIGHT])
    inside = (T > FLIGHT[0] + 1) & (T < FLIGHT[1] - 1)
    assert np.abs(above[inside] - 8.0).max() < 0.1


def test_without_a_flight_the_middle_is_the_ground_and_without_ground_the_lowest() -> None:
    x = np.where(T < 20.0, 103.0, 100.0)
    stream = Stream(T, x[:, None], "m", "", "BARO")
    assert ground(stream, [])[0] == 100.0
    assert ground(stream, [(T[0], T[-1])])[0] == 100.0


def test_where_a_log_ends_in_the_air_there_is_no_ground() -> None:
    x = np.where(T < 50.0, 100.0, 130.0)
    above = x - ground(Stream(T, x[:, None], "m", "", "BARO"), [(50.0, T[-1] - 0.15)])
    assert (above[T > 51.0] == 30.0).all()


def test_a_part_of_the_log_without_samples_has_no_height() -> None:
    t = np.concatenate([T[:800], T[1200:]])
    at, means = averaged(t, np.ones(len(t)))
    silent = (at > 80.5) & (at < 119.5)
    assert silent.any()
    assert np.isnan(means[silent]).all()
    assert np.nanmax(np.abs(means - 1.0)) == 0.0


@pytest.mark.parametrize(
    "name", ["copter_heading_28deg_off.BIN", "px4_1.14_clipping_field.ulg", "px4_1.8_hexa.ulg", "copter_3.3dev_181.BIN"]
)
def test_the_strip_tells_the_height_of_the_headline(corpus: Path, name: str) -> None:
    """The rangefinder of the first saw 11 m in all the flight, where its barometer peaked at 13 m in wind."""
    result = attlog.analyze(corpus / "logs" / "cases" / name, attlog.Config(estimators=("mahony",)))
    said = re.search(r"up to ([\d.]+ m)\b", result.headline)
    assert said is not None, result.headline
    assert strip(result).top == said.group(1)
