"""The table of sensors and the line of ``analyze``: no wider than the terminal, nothing cut off."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.cli.shared.sensor_table import sensor_lines, set_line, setting_lines
from attlog.health.assessments import Setting
from tests.health.assessments.made import MADE, OFFSET, REFUSED, SILENT, SOUND


@pytest.mark.parametrize("width", [60, 80, 100, 160])
@pytest.mark.parametrize("verbose", [False, True])
def test_the_table_fits_and_loses_no_word(width: int, verbose: bool) -> None:
    lines = [line.text for line in sensor_lines(MADE, str, width, verbose)]
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    for word in ("MAG.0", "compass offset", "COMPASS_OFS_X -12 -> 145", "COMPASS_OFS_Y 4.5 -> -20.25", "LOG_DISARMED"):
        assert word in text
    assert not [line for line in lines if line != line.rstrip()]


def test_what_is_off_without_anything_to_set_is_told_in_its_sentence() -> None:
    plain = replace(REFUSED, why_no_setting="")
    assert plain.text.replace("uT", "µT") in "\n".join(line.text for line in sensor_lines([plain], str, 160, False))


def test_what_is_sound_and_may_be_set_stands_in_the_table() -> None:
    suggestion = replace(SOUND, settings=[Setting("NOISE", 0.05, 0.03)])
    lines = [line.text for line in sensor_lines([suggestion], str, 160, False)]
    assert "    NOISE 0.05 -> 0.03" in lines
    assert not [line for line in lines if "ok:" in line]


def test_the_line_of_analyze_takes_two_lines_at_most_and_says_how_many_more() -> None:
    many = [Setting(f"COMPASS_OFS{k}_X", float(k), 145.0 + k) for k in range(12)]
    for count in (1, 2, 12):
        lines = [line.text for line in set_line(many[:count], "a_flight.bin", 80)]
        assert len(lines) <= 2
        assert max(map(len, lines)) <= 80
        assert lines[0].startswith("set       COMPASS_OFS0_X 0 -> 145")
        assert ("more" in " ".join(lines)) == (count == 12)
    assert list(set_line([], "a_flight.bin", 80)) == []
    (line,) = set_line(many, "a" * 200, 80)
    assert line.text == "set       12 parameters; attlog health shows which and why."


def test_settings_stand_a_line_each() -> None:
    assert [line.text for line in setting_lines(OFFSET.settings)] == [
        "set",
        "  COMPASS_OFS_X -12 -> 145",
        "  COMPASS_OFS_Y 4.5 -> -20.25",
    ]
    assert list(setting_lines([])) == []


def test_what_is_folded_counts_its_sensors_and_the_same_words_stand_once() -> None:
    twice = [REFUSED, replace(REFUSED, sensor="MAG.2"), SOUND, replace(SOUND, sensor="IMU.1"), SOUND]
    lines = [line.text for line in sensor_lines(twice, str, 160, False)]
    assert lines[-1] == "  ok: vibration (3)"
    assert "\n".join(lines).count(REFUSED.why_no_setting) == 1
    assert "    The same as for MAG.1." in lines


def test_a_long_name_of_a_sensor_leaves_the_value_a_line_of_its_own() -> None:
    long = replace(OFFSET, sensor="estimator_selector_status", question="accelerometer_temperature")
    lines = [line.text for line in sensor_lines([long], str, 80, False)]
    assert max(map(len, lines)) <= 80
    assert lines[2] == "    24.0 ± 3.0 µT"


def test_what_cannot_be_told_says_why_once_when_asked() -> None:
    same = [SILENT, replace(SILENT, sensor="GPS.1")]
    assert [line.text for line in sensor_lines(same, str, 80, False)] == ["  no answer: GNSS delay (2) (why: -v)"]
    assert [line.text for line in sensor_lines(same, str, 80, True)] == [
        "  no answer: GNSS delay of GPS.0; GNSS delay of GPS.1",
        f"      {SILENT.text}",
    ]
