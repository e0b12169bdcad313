"""Is a file that a command would write one that it reads, or somebody's flight log? Then it would be gone.

``--junit flight.bin`` is a slip of the fingers, a log cannot be flown again. Reports of earlier runs are replaced.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from inspect import signature
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

from typer.core import TyperCommand, TyperGroup

from attlog.cli.options import CommonOptions
from attlog.core.errors import AttlogError, UsageError

WRITTEN = {"junit": "--junit", "summary": "--summary", "output": "-o"}
"""Parameters of commands that name what is written, and the options that people type."""
OUTPUT_IS_A_FILE = ("extract", "diff", "table", "simulate")
"""Elsewhere ``-o`` is a folder, and a file of that name is left alone without this."""
WRITES_LOGS = "simulate"


def check(command: str, params: Mapping[str, Any]) -> None:
    """UsageError where a file to write, among the parameters of a command, is a log or one of the files to read."""
    read = [word for name, value in params.items() if name not in WRITTEN for word in _words(value)]
    for name, option in WRITTEN.items():
        if name == "output" and command not in OUTPUT_IS_A_FILE:
            continue
        for path in _words(params.get(name)):
            refuse(option, path, read, logs=command != WRITES_LOGS)


def refuse(option: str, path: str, read: Iterable[str], *, logs: bool = True) -> None:
    """UsageError where ``path``, which ``option`` would write, is a file that is read or, with ``logs``, a log."""
    if not os.path.isfile(path):
        return
    if any(os.path.isfile(word) and os.path.samefile(path, word) for word in read):
        raise UsageError(f"{option} {path}: is read by this command and would be overwritten; use another name")
    if logs and _is_log(path):
        raise UsageError(f"{option} {path}: is a flight log and would be overwritten; use another name")


def _words(value: Any) -> Iterator[str]:
    """The texts of a parameter that may be names of files, those of a list of filters one by one."""
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        yield text
        if "," in text:
            yield from text.split(",")
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _words(item)


def _is_log(path: str) -> bool:
    from attlog import formats

    try:
        formats.recognise(path)
    except AttlogError:
        return False
    return True


# The words of a command line: what may be left out, and what is taken as it was typed.


class AsTyped:
    """A Typer command or group whose parameters pass what needs no check."""

    def get_params(self, ctx: Any) -> list[Any]:
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        new = [parameter for parameter in found if "process_value" not in vars(parameter)]
        seen = signature(self.callback, eval_str=True).parameters if new else {}  # type: ignore[attr-defined]
        for parameter in new:
            made = WORDS.get(_item(seen[parameter.name].annotation)) if parameter.name in seen else None
            parameter.process_value = partial(_processed, parameter, parameter.process_value, made)
        return found


def _item(hint: Any) -> Any:
    """The type of a value, or of each of a list, where it may be None as well."""
    if get_origin(hint) is Annotated:
        return _item(get_args(hint)[0])
    others = [kind for kind in get_args(hint) if kind is not NoneType]
    return _item(others[0]) if len(others) == 1 or get_origin(hint) is list else hint


def _processed(
    parameter: Any, by_typer: Callable[..., Any], made: Callable[[str], Any] | None, context: Any, value: Any
) -> Any:
    """The value that the command gets."""
    many = parameter.multiple or parameter.nargs == -1
    if value is None and not parameter.required:
        found: Any = () if many else None
    elif isinstance(value, (bool, int, float, Path)):  # a flag, a count or a default
        found = value
    elif made is None or not value:
        return by_typer(context, value)
    else:
        words = value if many else (value,)
        items = tuple(made(word) if type(word) is str else None for word in words)
        if None in items:
            return by_typer(context, value)
        found = items if many else items[0]
    return found if parameter.callback is None else parameter.callback(context, parameter, found)


def _path(word: str) -> Path | None:
    """None where Typer may have something to say of a path."""
    return Path(word) if not os.path.lexists(word) or os.access(word, os.R_OK) else None


WORDS: dict[Any, Callable[[str], Any]] = {str: str, Path: _path}


SECTIONS = {
    "Output": ("output", "format", "json", "open", "name", "deterministic", "junit", "summary"),
    "Logs and filters": tuple("estimators imu mag reference truth window gyro-bias params config boot system".split()),
    "Every command": ("quiet", "verbose", "no-color", "key", "help"),
}
"""Options of the help by what they are about; those of the command's own work stand before them."""
TYPE = re.compile(r" <[^<>]*>$")
"""What Typer writes behind the name of an argument."""

DEFAULT = "analyze"
COMMON = re.compile("-[qv]+")
"""Options of every command that are written together."""
IN_CONFIG = ("score-from", "clock", "declination", "trim", "input-delay")
ELSEWHERE = {
    **{f"--{name}": f"write it into a file for --config: {name.replace('-', '_')} = ..." for name in IN_CONFIG},
    "--filter-timeout": "set the environment variable ATTLOG_FILTER_TIMEOUT (seconds; 0: any time)",
    "--junit": "attlog batch takes it",
    "--summary": "attlog batch takes it",
    "--strict": "attlog batch takes it; in the file of --gates it is strict = true",
    "--table": "--format md|csv|tex prints the table",
    "--workers": "it is -j or --jobs",
    "--plotly": "every page holds all that it draws with",
    "--watch": "run attlog batch --resume from a timer",
    "--settle": "run attlog batch --resume from a timer",
    "--generations": "a search has six",
}
"""Options that a command once had, and what serves instead."""


class Group(AsTyped, TyperGroup):
    """The commands; ``attlog flight.ulg`` means ``attlog analyze flight.ulg``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        none_is_empty(args)
        own = {name: option for option in self.get_params(ctx) for name in (*option.opts, *option.secondary_opts)}
        first = 0
        while first < len(args) and (args[first] in own or COMMON.fullmatch(args[first])):
            option = own.get(args[first])
            first += 1 if option is None or option.is_flag or option.count else 2
        rest = args[first:]
        if rest and rest[0] not in self.commands and looks_like_a_log(rest):
            args = [*args[:first], DEFAULT, *rest]
        return super().parse_args(ctx, args)


def looks_like_a_log(args: list[str]) -> bool:
    """Whether words without a command name logs or options of ``analyze``; a lone word is a mistyped command."""
    first = args[0]
    if first.startswith("-"):
        return len(args) > 1
    return any(c in first for c in "./\\*?") or os.path.exists(first)


def none_is_empty(args: list[str]) -> None:
    """UsageError for a word without a letter: mostly a variable of a script that was not set, and as a path it would
    mean the folder one is in."""
    for k, arg in enumerate(args):
        option, _, value = arg.partition("=")
        if arg == "" or (option.startswith("--") and arg.endswith("=") and not value):
            after = option or (f"after {args[k - 1]}" if k else "")
            raise UsageError(f"an empty word {after}".rstrip() + "; is a variable not set?")


class Plain(AsTyped, TyperCommand):
    """A command, which overwrites none of the files that it reads."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own = {name for option in self.get_params(ctx) for name in option.opts}
        for word in args[: args.index("--")] if "--" in args else args:
            name = word.partition("=")[0]
            if name in ELSEWHERE and name not in own:
                raise UsageError(f"{name}: no option of {self.name}; {ELSEWHERE[name]}")
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The help of arguments and options, in sections."""
        section = {f"--{name}": title for title, names in SECTIONS.items() for name in names}
        found: dict[str, list[tuple[str, str]]] = {title: [] for title in ("Arguments", "Options", *SECTIONS)}
        for parameter in self.get_params(ctx):
            written = parameter.get_help_record(ctx)
            if written is not None:
                argument = parameter.param_type_name == "argument"
                title = "Arguments" if argument else section.get(max(parameter.opts, key=len), "Options")
                found[title].append((TYPE.sub("", written[0]), written[1]))
        for title, lines in found.items():
            order = {f"--{name}": k for k, name in enumerate(SECTIONS.get(title, ()))}
            lines.sort(key=lambda line: next((order[w] for w in re.split("[ ,]+", line[0]) if w in order), 0))
            if lines:
                with formatter.section(title):
                    formatter.write_dl(lines)

    def invoke(self, ctx: Any) -> Any:
        check(str(self.name), ctx.params)
        if isinstance(ctx.obj, CommonOptions):  # what stood before the command
            ctx.params["quiet"] |= ctx.obj.quiet
            ctx.params["verbose"] += ctx.obj.verbose
        return super().invoke(ctx)


class WithJson(Plain):
    """A command whose ``--json`` may be followed by ``-``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        kept: list[str] = []
        for k, arg in enumerate(args):
            if arg.startswith("--json="):
                self._only_dash(arg.partition("=")[2])
                arg = "--json"
            elif k and args[k - 1] == "--json":
                if arg == "-":
                    continue
                if arg.endswith(".json"):
                    self._only_dash(arg)
            kept.append(arg)
        return super().parse_args(ctx, kept)

    @staticmethod
    def _only_dash(value: str) -> None:
        if value != "-":
            raise UsageError(f"--json {value}: only - (standard output); analyze writes files to the folder of -o")


class WithGates(WithJson):
    """A command whose ``--summary`` may be followed by a Markdown file."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        named = [k > 0 and args[k - 1] == "--summary" and arg.endswith(".md") for k, arg in enumerate([*args, ""])]
        bare = [arg == "--summary" and not named[k + 1] for k, arg in enumerate(args)]
        return super().parse_args(ctx, ["--summary=-" if alone else arg for arg, alone in zip(args, bare, strict=True)])


def command_line() -> str:
    """The command as it was typed, less the place of a private key: results are passed on."""
    kept, words = ["attlog"], iter(sys.argv[1:])
    for word in words:
        if word == "--":
            kept += [word, *words]
        elif word == "--key":
            next(words, None)
        elif not word.startswith("--key="):
            kept.append(word)
    return " ".join(kept)
