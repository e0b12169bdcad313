"""Which options there are: few, the same names for the same things, declared once; every help has an example."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import typer

from attlog.cli import app
from attlog.cli import options as completion
from attlog.cli.arguments import COMMANDS
from attlog.estimators import get, names
from tests.conftest import SAMPLES, few
from tests.golden import check_golden

LOG = SAMPLES / "copter_yaw_turns.bin"
COMMON = {"--quiet", "--verbose", "--no-color", "--key"}


def group() -> tuple[Any, Any]:
    """The group of commands, and a context of it."""
    found = typer.main.get_command(app)
    return found, found.context_class(found, info_name="attlog")


def options() -> dict[str, list[Any]]:
    """The options of each command."""
    found, context = group()
    every = {name: found.get_command(context, name).params for name in COMMANDS}
    return {name: [p for p in params if p.param_type_name == "option"] for name, params in every.items()}


def longest(option: Any) -> str:
    return max(option.opts, key=len)


def test_every_command_takes_the_common_options_and_short_names_mean_one_thing() -> None:
    long: dict[str, set[str]] = defaultdict(set)
    for name, found in options().items():
        assert {longest(o) for o in found} >= COMMON, name
        for option in found:
            for short in option.opts:
                if len(short) == 2:
                    long[short].add(longest(option))
    assert long == {"-q": {"--quiet"}, "-v": {"--verbose"}, "-o": {"--output"}, "-j": {"--jobs"}}


def test_analyze_and_batch_take_the_same_options_of_a_log_and_so_do_the_commands_that_compare() -> None:
    found = {name: {longest(o): o.help for o in of} for name, of in options().items()}
    assert {k for k in found["analyze"] if found["batch"].get(k) != found["analyze"][k]} == {
        "--output",
        "--jobs",
        "--json",
        "--format",
        "--open",
        "--figures",
        "--forum",
    }
    for name in ("sweep", "tune"):
        same = {k for k in found["compare"] if found[name].get(k) == found["compare"][k]}
        shared = {"--output", "--format", "--json", "--reference", "--truth", "--gyro-bias", "--config", "--anyway"}
        assert same - COMMON == shared


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example_that_the_command_understands_and_a_text_for_every_option(attlog: Any, name: str) -> None:
    found, context = group()
    command = found.get_command(context, name)
    first, *_, last = command.help.split("\n\n")
    assert first == command.get_short_help_str(57), "it is cut in the list of commands"
    words = shlex.split(last.removeprefix("Example: ").partition(" > ")[0])
    assert words[:2] == ["attlog", name]
    command.make_context(name, words[2:], parent=context)
    assert all(parameter.help for parameter in command.params)
    shown = attlog(name, "--help").out
    assert "Every command:" in shown
    assert not re.search(r"<(str|list|path)| \n", shown, re.IGNORECASE)


def test_help_of_analyze_and_of_the_group(attlog: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for file, words in (("help.txt", ["--help"]), ("help-analyze.txt", ["analyze", "--help"])):
        check_golden(Path(__file__).with_name("golden") / file, attlog(*words).out)


@pytest.mark.parametrize("words", [("-q", "info", LOG), ("info", LOG, "-q"), ("-q", LOG, "--estimators", "gyro")])
def test_common_options_stand_before_the_command_or_after_it(attlog: Any, tmp_path: Any, words: Any) -> None:
    more = () if "info" in words else ("-o", tmp_path)
    done = attlog(*words, *more)
    assert (done.code, done.out) == (0, "")


def test_verbose_before_and_after_the_command_adds_up(attlog: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(
        "attlog.cli.commands.inspect.info_lines", lambda report, width, verbose: seen.append(verbose) or []
    )
    for words in (("info", LOG), ("-v", "info", LOG), ("-vv", "info", LOG, "-v")):
        assert attlog(*words).code == 0
    assert seen == [0, 1, 3]


# What the shell is offered after TAB.


def offered(line: str) -> list[str]:
    """What bash would be offered for the last word of a line."""
    words = line.split(" ")
    env = {**os.environ, "_ATTLOG_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    code = "from attlog.cli import app; app(prog_name='attlog')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    few(
        [
            ("attlog analyze --window ho", ["hover"]),
            ("attlog analyze --estimators gyro,vq", ["gyro,vqf"]),
            ("attlog estimators madg", ["madgwick"]),
            (f"attlog extract {SAMPLES / 'copter_yaw_turns.bin'} ATT", ["ATT"]),
        ],
        1,
    ),
)
def test_the_shell_is_offered_names(line: str, expected: list[str]) -> None:
    assert offered(line) == expected


def test_presets_stand_behind_their_filter() -> None:
    assert completion.complete_rows("gyro,mahony@") == [f"gyro,mahony@{preset}" for preset in get("mahony").presets]
    assert completion.complete_rows("nope@") == []
    assert set(completion.complete_rows("")) == {"default", "all", *names()}
