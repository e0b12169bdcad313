"""Gravity, magnetic field and the earth's own turn against published numbers."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from attlog.core import earth


def unix(year: int, month: int, day: int) -> float:
    """Unix time of a date at midnight UTC."""
    return datetime(year, month, day, tzinfo=UTC).timestamp()


def test_gravity_has_the_values_of_wgs_84_at_equator_and_pole():
    """NIMA TR8350.2, table 3.4: 9.7803253359 and 9.8321849378 m/s^2."""
    assert earth.gravity(0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert earth.gravity(90.0) == pytest.approx(9.8321849378, abs=1e-9)
    assert earth.gravity(-45.0) == earth.gravity(45.0)


@pytest.mark.parametrize(
    ("lat", "lon", "height_m", "declination", "inclination", "strength_nt"),
    [(80.0, 0.0, 0.0, -1.28, 83.14, 55000.1), (0.0, 120.0, 0.0, 0.16, -15.42, 41104.9)],
)
def test_the_field_has_the_published_test_values_of_2020(lat, lon, height_m, declination, inclination, strength_nt):
    """The US/UK World Magnetic Model for 2020-2025, table of test values, 2020.0."""
    field = earth.field(lat, lon, height_m, unix(2020, 1, 1))
    assert field is not None
    assert field.declination_deg == pytest.approx(declination, abs=0.006)
    assert field.inclination_deg == pytest.approx(inclination, abs=0.006)
    assert field.strength_t * 1e9 == pytest.approx(strength_nt, abs=0.1)


@pytest.mark.parametrize(
    ("day", "model"),
    [((2013, 6, 1), "WMM-2010"), ((2017, 6, 1), "WMM-2015v2"), ((2024, 12, 1), "WMM-2020"), ((2026, 8, 1), "WMM-2025")],
)
def test_each_date_gets_the_model_of_its_own_epoch(day, model):
    field = earth.field(47.4, 8.5, 400.0, unix(*day))
    assert field is not None
    assert field.model.startswith(model)
    assert f"{day[0]}." in field.model


def test_without_a_date_the_newest_model_is_taken_and_says_so():
    field = earth.field(47.4, 8.5, 400.0, None)
    assert field is not None
    assert "date unknown" in field.model
    assert field.declination_deg == pytest.approx(3.6, abs=0.2)


@pytest.mark.parametrize(
    ("lat", "lon", "when"),
    [
        (float("nan"), 0.0, unix(2020, 1, 1)),
        (91.0, 0.0, unix(2020, 1, 1)),
        (0.0, 181.0, unix(2020, 1, 1)),
        (47.0, 8.0, 0.0),
        (47.0, 8.0, unix(2031, 1, 1)),
        (47.0, 8.0, 1e15),
        (47.0, 8.0, float("nan")),
    ],
)
def test_no_place_or_no_date_of_any_model_gives_no_field(lat, lon, when):
    assert earth.field(lat, lon, 0.0, when) is None


def test_the_earth_turns_a_resting_heading_by_a_quarter_degree_per_minute_at_the_pole():
    assert earth.heading_turn(90.0) == pytest.approx(-360 / 1436.068, abs=1e-6)
    assert earth.heading_turn(0.0) == 0.0
    assert earth.heading_turn(-30.0) == pytest.approx(0.1253, abs=1e-4)
