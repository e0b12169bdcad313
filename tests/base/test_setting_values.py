"""What a setting may be: each kind takes what it says, and says what it takes."""

from __future__ import annotations

import math
from typing import Any

import pytest

from attlog.analysis.config import KINDS, Config
from attlog.base.errors import UsageError
from attlog.base.setting_values import Kind, either, number, or_none, text, truth, whole, words


@pytest.mark.parametrize(
    ("kind", "given", "kept"),
    [
        (whole(), -3, -3),
        (whole(), " 12 ", 12),
        (whole(), 4.0, 4),
        (whole(0, 255), 255, 255),
        (number(-180.0, 180.0), 3, 3.0),
        (number(-180.0, 180.0), "-180", -180.0),
        (words("a", "b"), "b", "b"),
        (truth(), "off", False),
        (truth(), 1, True),
        (either(whole(), words("all")), "all", "all"),
        (either(whole(), words("all")), "7", 7),
        (or_none(text()), None, None),
    ],
)
def test_a_value_of_the_kind_is_kept_in_one_form(kind: Kind, given: Any, kept: Any) -> None:
    found = kind.checked(given)
    assert found == kept
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    ("kind", "given", "says"),
    [
        (whole(), True, "use a whole number"),
        (whole(), 1.5, "use a whole number"),
        (whole(), math.inf, "use a whole number"),
        (whole(0, 255), 256, "use a whole number from 0 to 255"),
        (number(0.0, 1e6), math.nan, "use a number from 0 to 1,000,000"),
        (number(0.0, 1e6), 10**400, "use a number from 0"),
        (number(0.0, 1e6), -1, "use a number from 0"),
        (number(0.0, 1e6), [1], "use a number from 0"),
        (words("a", "b", "c"), "d", r"use a, b or c \(got 'd'\)"),
        (words("a"), ["a"], "use a "),
        (truth(), "perhaps", "use true or false"),
        (truth(), None, "use true or false"),
        (text(), 3, "use text"),
        (either(number(0.0, 9.0), words("auto", "off")), "x", "use a number from 0 to 9, auto or off"),
    ],
)
def test_what_is_none_of_the_kind_is_told_with_what_would_be(kind: Kind, given: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        kind.checked(given)


def test_every_key_of_a_configuration_has_a_kind_that_takes_its_default() -> None:
    assert list(Config().__dict__) == list(KINDS)
    for name, value in Config().__dict__.items():
        assert KINDS[name].checked(value) == value


def test_a_configuration_is_checked_when_it_is_changed() -> None:
    config = Config(estimators="gyro,mahony:kp=1")  # type: ignore[arg-type]
    assert config.estimators == ["gyro", "mahony:kp=1"]
    config.declination = "4.5"  # type: ignore[assignment]
    assert config.declination == 4.5
    with pytest.raises(UsageError, match="declination: use a number from -180 to 180, auto, model or param"):
        config.declination = 181.0
    with pytest.raises(UsageError, match="unknown key 'windw'; did you mean window"):
        config.windw = "all"  # type: ignore[attr-defined]


def test_all_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(UsageError) as error:
        Config.build({"boot": -1, "clocks": "sample", "trim": "maybe"}, origin="f.toml")
    lines = str(error.value).splitlines()
    assert [line.split(":")[0] for line in lines] == ["f.toml"] * 3
    assert "did you mean clock?" in lines[1]
