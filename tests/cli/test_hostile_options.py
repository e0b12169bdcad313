"""Numbers that are none, or are out of all proportion: exit code 2 and a sentence, whatever the option."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.conftest import SAMPLES

LOG = SAMPLES / "copter_yaw_turns.bin"
OPTIONS: dict[str, tuple[str, ...]] = {
    "analyze": ("--imu", "--mag", "--boot", "--system", "-j"),
    "extract": ("--from", "--to", "--boot", "--system"),
    "batch": ("--timeout", "--memory", "-j"),
}
CASES = [(command, option) for command, options in OPTIONS.items() for option in options]


@pytest.mark.parametrize(("command", "option"), CASES, ids=[f"{c} {o}" for c, o in CASES])
@pytest.mark.parametrize("word", ["nan", "-inf", "1e999", "", "0x10"])
def test_what_is_no_number_is_refused(
    attlog: Callable[..., Any], command: str, option: str, word: str, tmp_path: Any
) -> None:
    done = attlog(command, LOG, f"{option}={word}" if option.startswith("--") else f"{option}{word}", "-o", tmp_path)
    if option == "-j" and not word:
        pytest.skip("-j without a number takes the next word for it")
    assert done.code == 2
    assert len(done.err) > 20
    assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ("--window", "nan:1"),
        ("--window", "0:inf"),
        ("--params", "/dev/zero"),
        ("--config", "/dev/zero"),
        ("--gates", "/dev/zero"),
    ],
)
def test_numbers_and_files_out_of_all_proportion_are_refused(
    attlog: Callable[..., Any], words: tuple[str, str], tmp_path: Any
) -> None:
    done = attlog("analyze", LOG, *words, "-o", tmp_path)
    assert done.code == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("word", ["EKF2_MAG_DECL=nan", "EKF2_MAG_DECL=1e999", "EKF2_MAG_DECL=", "=1"])
def test_a_simulated_log_tells_no_parameter_that_is_no_number(
    attlog: Callable[..., Any], word: str, tmp_path: Any
) -> None:
    assert attlog("simulate", "hover", "-o", tmp_path / "x.ulg", "--param", word).code == 2
