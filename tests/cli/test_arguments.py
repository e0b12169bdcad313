"""What may be left out, what is taken as typed, and what ``--help`` tells of it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import SAMPLES, few

GYRO = ("--estimators", "gyro", "-q")


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", few([["LOG", "-o", "OUT"], ["-o", "OUT", "LOG"], ["./*.bin", "-o", "OUT"], [".", "-o", "OUT"]], 2)
)
def test_the_word_analyze_may_be_left_out(attlog, samples, tmp_path, monkeypatch, words):
    shutil.copy(samples / "copter_yaw_turns.bin", tmp_path / "a.bin")
    monkeypatch.chdir(tmp_path)
    given = [{"LOG": "a.bin", "OUT": str(tmp_path / "out")}.get(word, word) for word in words]
    done = attlog(*given, *GYRO)
    assert (done.code, done.out, done.err) == (0, "", "")
    assert (tmp_path / "out" / "a.bin.html").exists()


def test_words_and_paths_are_read_without_pydantic_and_checked_with_it(attlog, samples, tmp_path):
    """Its import takes 0.1 s of each command."""
    log = str(samples / "copter_yaw_turns.bin")
    code = (
        f"import sys\nsys.argv = ['attlog', '-q', 'info', {log!r}]\nfrom attlog.cli import main\n"
        "try: main()\nexcept SystemExit as end: print(end.code, 'pydantic' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0", "False"]
    refused = attlog("info", log, "--boot", "one")
    assert refused.code == 2
    assert "--boot" in refused.err


@pytest.mark.parametrize("command", few(["info", "analyze"], 1))
def test_several_logs_are_one_object_a_line(attlog, samples, tmp_path, command):
    logs = [samples / "copter_yaw_turns.bin", samples / "px4_hover.ulg"]
    more = ["-o", tmp_path, "--estimators", "gyro"] if command == "analyze" else []
    done = attlog(command, *logs, "--json", *more)
    assert done.code == 0, done.err
    assert [json.loads(line)["log"]["name"] for line in done.out.splitlines()] == [log.name for log in logs]
    if command == "analyze":
        assert "2 logs: 2 reports in" in done.err


@pytest.mark.slow
def test_an_earlier_result_is_a_configuration(attlog, samples, tmp_path):
    log = samples / "copter_yaw_turns.bin"
    (tmp_path / "c.toml").write_text("declination = 3.0\nscore_from = 20.0\n")
    asked = ["--estimators", "gyro,mahony:kp=0.7", "--window", "10:40", "--config", tmp_path / "c.toml"]
    assert attlog("analyze", log, "-o", tmp_path / "a", *asked).code == 0
    again = attlog("analyze", log, "-o", tmp_path / "b", "--config", tmp_path / "a" / f"{log.name}.json")
    assert again.code == 0, again.err
    first, second = (json.loads((tmp_path / x / f"{log.name}.json").read_text()) for x in "ab")
    assert first["config"] == second["config"]
    assert first["config"]["declination"] == 3.0
    other = attlog("analyze", log, "-o", tmp_path / "c", "-q", "--config", tmp_path / "a" / f"{log.name}.json", *GYRO)
    assert other.code == 0, other.err
    assert json.loads((tmp_path / "c" / f"{log.name}.json").read_text())["config"] == first["config"] | {
        "estimators": ["gyro"]
    }


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"schema": "x"}', "no object named config"),
        ("{", "not valid JSON"),
        ('{"clok": "sample"}', "did you mean clock?"),
    ],
)
def test_a_json_file_that_is_no_configuration_is_2(attlog, samples, tmp_path, text, told):
    (tmp_path / "c.json").write_text(text)
    done = attlog("analyze", samples / "copter_yaw_turns.bin", "--config", tmp_path / "c.json", "-o", tmp_path / "out")
    assert done.code == 2
    assert told in done.err


# Numbers that are none, or are out of all proportion: exit code 2 and a sentence, whatever the option.

LOG = SAMPLES / "copter_yaw_turns.bin"
OPTIONS: dict[str, tuple[str, ...]] = {
    "analyze": ("--imu", "--mag", "--boot", "--system", "-j"),
    "extract": ("--from", "--to", "--boot", "--system"),
    "batch": ("--timeout", "--memory", "-j"),
}
CASES = [(command, option) for command, options in OPTIONS.items() for option in options]


@pytest.mark.parametrize(("command", "option"), CASES, ids=[f"{c} {o}" for c, o in CASES])
@pytest.mark.parametrize("word", ["nan", "1e999", "", "0x10"])
def test_what_is_no_number_is_refused(
    attlog: Callable[..., Any], command: str, option: str, word: str, tmp_path: Any
) -> None:
    if option == "-j" and not word:
        return  # takes the next word for its number
    done = attlog(command, LOG, f"{option}={word}" if option.startswith("--") else f"{option}{word}", "-o", tmp_path)
    assert done.code == 2
    assert len(done.err) > 20
    assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        *(("analyze", LOG, "--window", window) for window in ("nan:1", "0:inf")),
        *(("analyze", LOG, option, "/dev/zero") for option in ("--params", "--config", "--gates")),
        *(("simulate", "hover", "--param", f"{word}") for word in ("EKF2_MAG_DECL=nan", "EKF2_MAG_DECL=", "=1")),
        ("anlyze", "flight.ulg"),
    ],
)
def test_numbers_and_files_out_of_all_proportion_are_refused(attlog: Any, words: Any, tmp_path: Any) -> None:
    assert attlog(*words, "-o", tmp_path / "x.ulg").code == 2
    assert list(tmp_path.iterdir()) == []


# What people write where the command line takes something else: the answer names how it is written here.

LOG_NAME = "copter_yaw_turns.bin"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("analyze", LOG_NAME, "--estimators", "mahony:kp=0,3"), "did you mean kp=0.3?"),
        (("analyze", LOG_NAME, "--estimators", "gyro,mahony:ki=0.1,kp=1,25"), "did you mean kp=1.25?"),
        (("extract", LOG_NAME, "--estimates", "mahony:kp=0,3"), "did you mean kp=0.3?"),
        (("compare", LOG_NAME, "mahony", "mahony:ki=1,kp=0,3"), "did you mean kp=0.3?"),
        (("sweep", LOG_NAME, "mahony:kp=0,3", "ki=0..1/3"), "did you mean kp=0.3?"),
        (("sweep", LOG_NAME, "mahony", "kp=0,5..2/4"), "did you mean kp=0.5?"),
        (("sweep", LOG_NAME, "mahony", "kp=0,3"), "write kp=0.3 for one number, kp=0.0,3 for two"),
        (("sweep", LOG_NAME, "mahony", "kp=1,05"), "write kp=1.05 for one number"),
        (("analyze", LOG_NAME, "--estimators", "mahony", "mekf"), "mekf: is a filter, not a log; list filters with "),
        (("batch", LOG_NAME, "-o", "x", "--estimators", "mahony", "mekf@x"), "with commas: --estimators NAME,mekf@x"),
        (("extract", LOG_NAME, "--estimates", "-o", "est"), "--estimates: has no value before -o; write --estimates"),
        (("simulate", "hover", "--seed", "--output=x.ulg"), "--seed: has no value before --output=x.ulg"),
        (("my logs/a.bin".split()), 'a path with spaces needs quotes: "my logs/a.bin"'),
        (("info", *"my logs/a.bin".split()), 'a path with spaces needs quotes: "my logs/a.bin"'),
        (("tune", LOG_NAME, "mahony", "kp=0,3..2"), "did you mean kp=0.3?"),
        (("sweep", LOG_NAME, "mahony", "kp=0.1-2"), "kp=0.1..2/12"),
        (("sweep", LOG_NAME, "mahony", "kp=1e-2:2"), "kp=1e-2..2/12"),
        (("sweep", LOG_NAME, "mahony", "kp=0.1..2"), "kp=0.1..2/12"),
        (("tune", LOG_NAME, "mahony", "kp=0.1-2"), "kp=0.1..2,"),
        (("compare", LOG_NAME, "gyro", "mahony:kp=0.1-2"), "attlog sweep takes a range, written kp=0.1..2/12"),
        (("analyze", LOG_NAME, "--estimators", "mahony:latency=20,kp=1"), "compare LOG mahony mahony:latency=20,kp=1"),
        (("extract", LOG_NAME, "--estimates", "mahony:lowpass=20"), "attlog compare LOG mahony mahony:lowpass=20"),
        (("compare", LOG_NAME, "mahony:kp=0.6", "mahony:kp=0.60"), "is the same configuration as mahony:kp=0.6; a"),
        (("compare", LOG_NAME, "mahony", "mahony"), "mahony is given twice; a comparison needs two that differ"),
        (("compare", LOG_NAME, "mahony"), "a comparison needs two configurations or more"),
    ],
)
def test_the_answer_to_another_writing_names_ours(attlog, samples, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    Path("my logs").mkdir()
    for place in (LOG_NAME, "my logs/a.bin"):
        Path(place).symlink_to(samples / LOG_NAME)
    done = attlog(*words)
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) == 1


def test_help_is_a_command_too(attlog):
    assert attlog("help").out == attlog("--help").out
    assert attlog("help", "info").out == attlog("info", "--help").out


@pytest.mark.parametrize("command", ["analyze", "info", "health", "extract", "reproduce xu --logs"])
def test_a_mistyped_log_is_answered_with_the_nearest_name(attlog, samples, monkeypatch, command):
    monkeypatch.chdir(samples)
    done = attlog(*command.split(), "Copter_yaw_turn.bin")
    assert (done.code, done.err) == (66, f"attlog: Copter_yaw_turn.bin: no such file; did you mean {LOG_NAME}?\n")
    assert attlog(*command.split(), "zzz/copter_yaw_turns.bin").err == (
        "attlog: zzz/copter_yaw_turns.bin: no such file\n"
    )


def test_a_list_of_two_whole_numbers_is_swept_and_said_to_be_two(attlog, samples, tmp_path):
    given = ("--reference", "onboard", "-q", "-o", tmp_path)
    done = attlog("sweep", samples / LOG_NAME, "mahony", "kp=1,5", *given)
    assert done.code == 0
    assert done.err == "attlog: kp=1,5 are two values, 1 and 5; the number is written 1.5\n"
    assert attlog("sweep", samples / LOG_NAME, "mahony", "kp=0.0,3", *given).err == ""
