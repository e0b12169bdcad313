"""Which options there are: few, the same names for the same things, declared once; every help has an example."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from typing import Any

import pytest
import typer

from attlog.cli import COMMANDS, app
from attlog.cli import options as completion
from attlog.estimators import get, names
from tests.conftest import SAMPLES, few

LOG = SAMPLES / "copter_yaw_turns.bin"
COMMON = {"--quiet", "--verbose", "--no-color", "--key"}
MOST = 123
"""Options of all commands; those of every command count once. 161 were too many to be learned."""


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


def test_there_are_not_too_many_options() -> None:
    own = [longest(o) for found in options().values() for o in found if longest(o) not in COMMON]
    assert 60 < len(own) + len(COMMON) + len(["--version"]) <= MOST


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
    }
    for name in ("sweep", "tune"):
        same = {k for k in found["compare"] if found[name].get(k) == found["compare"][k]}
        assert same - COMMON == {"--output", "--format", "--json", "--reference", "--truth", "--gyro-bias", "--config"}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_sentences_and_an_example_that_the_command_understands(name: str) -> None:
    found, context = group()
    command = found.get_command(context, name)
    first, *_, last = command.help.split("\n\n")
    assert first.endswith(".")
    assert first == command.get_short_help_str(57), "it is cut in the list of commands"
    words = shlex.split(last.removeprefix("Example: ").partition(" > ")[0])
    assert last.startswith("Example: ")
    assert words[:2] == ["attlog", name]
    command.make_context(name, words[2:], parent=context)
    assert all(o.help for o in command.params if o.param_type_name == "option")


SENTENCE = re.compile(r"[A-Z][a-z]+ .*\.( \[default: .*\])?")
IDEAS = {
    "--estimators": "these filters",
    "--format": "",
    "--jobs": "at a time",
    "--json": "Print JSON on standard output, one line for each ",
    "--metric": "metric",
    "--output": "Write ",
    "--params": "Use the parameters of this file",
    "--seed": "Seed ",
    "--seeds": "Fly ",
    "--window": "window",
}
"""What all helps of an option say that are not the same in each command."""


def test_the_help_of_every_option_and_argument_is_a_sentence_with_a_full_stop() -> None:
    found, context = group()
    for name in COMMANDS:
        for parameter in found.get_command(context, name).params:
            assert SENTENCE.fullmatch(parameter.help), (name, parameter.name, parameter.help)


def test_an_option_means_the_same_in_every_command() -> None:
    helps: dict[str, set[str]] = defaultdict(set)
    for of in options().values():
        for option in of:
            helps[longest(option)].add(option.help)
    for name, texts in helps.items():
        assert len(texts) == 1 or all(IDEAS[name] in text for text in texts), (name, texts)


@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_does_and_its_own_options_fit_one_screen(
    attlog: Any, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    own, _, rest = attlog(name, "--help").out.partition("Logs and filters:")
    assert len(own.splitlines()) <= 50
    assert "Every command:" in own + rest
    assert not re.search(r"<(str|list|path)", own + rest, re.IGNORECASE), "types of Python are no words for people"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("analyze", LOG, "--clock", "sample"), "--clock: no option of analyze; write it into a file for --config"),
        (("batch", LOG, "-o", "x", "--input-delay=3"), "input_delay = ..."),
        (("compare", LOG, "gyro", "vqf", "--filter-timeout", "3"), "ATTLOG_FILTER_TIMEOUT"),
        (("analyze", LOG, "--junit", "x.xml"), "attlog batch takes it"),
        (("sweep", LOG, "mahony", "kp=1", "--table", "x.tex"), "--format md|csv|tex"),
    ],
)
def test_an_option_that_is_gone_says_what_serves_instead(attlog: Any, words: tuple[Any, ...], said: str) -> None:
    done = attlog(*words)
    assert (done.code, done.out) == (2, "")
    assert said in done.err


@pytest.mark.parametrize("words", [("-q", "info", LOG), ("info", LOG, "-q"), ("-q", LOG, "--estimators", "gyro")])
def test_common_options_stand_before_the_command_or_after_it(attlog: Any, tmp_path: Any, words: Any) -> None:
    more = () if "info" in words else ("-o", tmp_path)
    done = attlog(*words, *more)
    assert (done.code, done.out) == (0, "")


def test_verbose_before_and_after_the_command_adds_up(attlog: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr("attlog.cli.commands.info.lines", lambda report, width, verbose: seen.append(verbose) or [])
    for words in (("info", LOG), ("-v", "info", LOG), ("-vv", "info", LOG, "-v")):
        assert attlog(*words).code == 0
    assert seen == [0, 1, 3]


def test_one_thing_at_a_time_goes_to_standard_output(attlog: Any, tmp_path: Any) -> None:
    done = attlog("analyze", LOG, "--json", "--format", "md", "-o", tmp_path)
    assert done.code == 2
    assert "one or the other" in done.err
    assert list(tmp_path.iterdir()) == []


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
