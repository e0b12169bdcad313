"""What may be left out, what is taken as typed, and what ``--help`` tells of it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from attlog.cli.shared.arguments import Plain
from attlog.cli.shared.options import finite
from tests.conftest import few

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


def test_a_mistyped_command_is_told_with_the_one_that_was_meant(attlog):
    done = attlog("anlyze", "flight.ulg")
    assert done.code == 2
    assert "analyze" in done.err


@pytest.mark.slow
@pytest.mark.parametrize("asked", few([["--json"], ["--json", "-"], ["--json=-"]], 2))
@pytest.mark.parametrize("command", ["info", "analyze"])
def test_json_on_standard_output_with_or_without_a_dash(attlog, samples, tmp_path, asked, command):
    more = ["-o", tmp_path, *GYRO] if command == "analyze" else []
    done = attlog(command, *asked, samples / "copter_yaw_turns.bin", *more)
    assert done.code == 0, done.err
    assert json.loads(done.out)["log"]["name"] == "copter_yaw_turns.bin"
    assert len(done.out.splitlines()) == 1  # also where a pattern happens to match one log


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
def test_a_summary_names_what_has_no_report(attlog, samples, tmp_path):
    (tmp_path / "bad.ulg").write_bytes(b"x" * 500)
    done = attlog(samples / "copter_yaw_turns.bin", tmp_path / "bad.ulg", "-o", tmp_path, "--estimators", "gyro")
    assert done.code == 65
    assert "2 logs: 1 report in" in done.out
    assert "1 log cannot be used (exit code 65):\n    not a flight log" in done.out
    assert "(bad.ulg)" in done.out


@pytest.mark.parametrize("command", ["analyze", "info", "extract", "estimators", "new", "check-estimator", "schema"])
def test_help_is_plain_and_loses_no_bracket(attlog, command):
    done = attlog(command, "--help")
    assert done.code == 0
    assert [line for line in done.out.splitlines() if line != line.rstrip()] == []
    if command == "analyze":
        text = " ".join(done.out.split())
        for told in ("NAME[@PRESET][:k=v,...]", "[default: the one used in flight]", "[default: reports]"):
            assert told in text


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


@pytest.mark.slow
def test_deterministic_reports_have_the_same_bytes(attlog, samples, tmp_path):
    pages = []
    for _ in range(2):
        done = attlog(samples / "copter_yaw_turns.bin", "-o", tmp_path, "--estimators", "gyro,vqf", "--deterministic")
        assert done.code == 0, done.err
        pages.append((tmp_path / "copter_yaw_turns.bin.html").read_bytes())
    assert pages[0] == pages[1]


@pytest.mark.slow
def test_several_jobs_print_every_result(attlog, samples, tmp_path):
    logs = [samples / "copter_yaw_turns.bin", samples / "px4_hover.ulg"]
    done = attlog("-j", 2, *logs, "-o", tmp_path, "--estimators", "gyro", "--json")
    assert done.code == 0, done.err
    assert {json.loads(line)["log"]["name"] for line in done.out.splitlines()} == {log.name for log in logs}


SEEN: list[dict[str, Any]] = []


def _told(**values: Any) -> None:
    SEEN.append(values)


def command(
    logs: Annotated[list[Path], typer.Argument(readable=False)],
    places: Annotated[list[str] | None, typer.Option("--place")] = None,
    output: Annotated[Path, typer.Option("-o")] = Path("reports"),
    config: Annotated[Path | None, typer.Option()] = None,
    window: str | None = None,
    jobs: Annotated[int, typer.Option("-j", min=1)] = 1,
    score: Annotated[float | None, typer.Option(callback=finite)] = None,
    quiet: Annotated[bool, typer.Option("-q")] = False,
    strict: Annotated[bool | None, typer.Option("--strict/--no-strict")] = None,
    verbose: Annotated[int, typer.Option("-v", count=True)] = 0,
) -> None:
    _told(**locals())


def run(words: list[str], cls: Any) -> tuple[int, Any, str]:
    """Exit code, what the command got, what was said."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(cls=cls)(command)
    SEEN.clear()
    done = CliRunner().invoke(app, words)
    return done.exit_code, [{k: (v, type(v)) for k, v in seen.items()} for seen in SEEN], done.output


@pytest.mark.parametrize(
    "words",
    [
        ["a.ulg"],
        ["a.ulg", "b\udcff.ulg", "-o", "", "--window", ""],
        ["a.ulg", "--place", "x", "--place", "y", "-o", "out", "--config", __file__, "--window", "3:4"],
        ["a.ulg", "-j", "3", "--score", "1.5", "-q", "-vv", "--no-strict"],
        ["a.ulg", "-j", "0"],
        ["a.ulg", "-j", "x"],
        ["a.ulg", "--score", "nan"],
        ["--window", "3"],
        [],
    ],
    ids=" ".join,
)
def test_a_command_gets_what_typer_would_give_it(words: list[str]) -> None:
    assert run(words, Plain) == run(words, None)


def test_the_help_has_all_that_typer_has_in_sections_without_types_of_python() -> None:
    ours, theirs = (run(["--help"], cls)[2] for cls in (Plain, None))
    assert set(re.findall(r"--?[a-z-]+", ours)) == set(re.findall(r"--?[a-z-]+", theirs))
    assert ours.index("Options:") < ours.index("Logs and filters:") < ours.index("Every command:")
    assert "<" in theirs
    assert not re.search(r"<(str|path|list)", ours, re.IGNORECASE)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a file that may not be read")
def test_a_path_that_may_not_be_read_is_left_to_typer(tmp_path: Path) -> None:
    closed = tmp_path / "closed.toml"
    closed.write_text("")
    closed.chmod(0)
    words = ["a.ulg", "--config", str(closed)]
    assert run(words, Plain) == run(words, None)
    assert run(words, Plain)[0] == 2


def test_text_and_paths_ask_no_validator() -> None:
    """Typer imports pydantic for the first value that it looks at."""
    code = (
        "import sys\nfrom tests.cli.shared.test_arguments import run\nfrom attlog.cli.shared.arguments import Plain\n"
        "assert run(['a.ulg', '-o', 'out', '--window', '3:4', '-q', '-v'], Plain)[0] == 0\n"
        "print('pydantic' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
