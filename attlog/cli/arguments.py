"""Typer's group and command with ``attlog LOG``, sections of help, and inputs that are never overwritten."""

from __future__ import annotations

import itertools
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from attlog.cli import process
from attlog.cli.options import COMMON, CommonOptions, with_options
from attlog.core.errors import AttlogError, UsageError

DEFAULT_COMMAND = "analyze"
# Commands and their modules in ``commands``, in the order of the help.
COMMANDS = {
    **{"analyze": "analyze", "batch": "batch"},
    **dict.fromkeys(("info", "health", "extract"), "inspect"),
    **dict.fromkeys(("compare", "diff"), "compare"),
    **dict.fromkeys(("sweep", "tune"), "search"),
    "table": "batch",
    **dict.fromkeys(("estimators", "new", "check-estimator"), "filters"),
    **dict.fromkeys(("reproduce", "simulate"), "simulate"),
    "mcp": "mcp",
    "schema": "analyze",
}
OUTPUT_OPTIONS = {"junit": "--junit", "summary": "--summary", "output": "-o"}
# Elsewhere ``-o`` is a folder.
OUTPUT_IS_A_FILE = ("extract", "diff", "table", "simulate")
WRITES_LOGS = "simulate"
PYTHON_TYPE = re.compile(r" <[^<>]*>$")  # in Typer's help, behind the name of an argument


def _path(word: str) -> Path | None:
    """Return a path; None where Typer may have to refuse it."""
    return Path(word) if not os.path.lexists(word) or os.access(word, os.R_OK) else None


# How words become values without a check of Typer's.
AS_TYPED: dict[Any, Callable[[Any], Any]] = {
    Path: _path,
    Path | None: _path,
    str | None: str,
    list[str]: list,
    list[str] | None: list,
    list[Path]: lambda words: [Path(word) for word in words],
}


class AsTyped:
    """Command or group that reads words, paths and defaults itself: for any value Typer imports pydantic, 0.1 s."""

    def get_params(self, ctx: Any) -> list[Any]:
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        new = [parameter for parameter in found if "process_value" not in vars(parameter)]
        hints = get_type_hints(self.callback) if new else {}  # type: ignore[attr-defined]
        for parameter in new:
            as_typed = AS_TYPED.get(hints.get(parameter.name), lambda _: None)
            parameter.process_value = partial(_processed, parameter, as_typed, parameter.process_value)
        return found


def _processed(
    parameter: Any, as_typed: Callable[[Any], Any], by_typer: Callable[..., Any], ctx: Any, value: Any
) -> Any:
    several = parameter.multiple or parameter.nargs == -1
    if isinstance(value, str | list | tuple) and value:
        made = as_typed(value)
    else:
        made = value if isinstance(value, bool | int | float | Path) else None
    if value is None and not parameter.required:
        made = () if several else None
    elif made is None:
        return by_typer(ctx, value)
    return made if parameter.callback is None else parameter.callback(ctx, parameter, made)


class Group(AsTyped, TyperGroup):
    """Commands, each imported when it is asked for; ``attlog flight.ulg`` means ``attlog analyze flight.ulg``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: dict[str, Any] = dict.fromkeys(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in self.commands and self.commands[cmd_name] is None:
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            module = import_module(f"attlog.cli.commands.{COMMANDS[cmd_name]}")
            function = getattr(module, f"{cmd_name.replace('-', '_')}_command")
            alone.command(cmd_name, cls=Command)(with_options(function))
            self.commands[cmd_name] = typer.main.get_command(alone)
        return super().get_command(ctx, cmd_name)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        refuse_empty_words(args)
        params: list[Any] = self.get_params(ctx)
        own = {name: option for option in params for name in (*option.opts, *option.secondary_opts)}
        first = 0
        while first < len(args) and (args[first] in own or re.fullmatch("-[qv]+", args[first])):
            option = own.get(args[first])
            first += 1 if option is None or option.is_flag or option.count else 2
        rest = args[first:]
        if rest[:1] == ["help"] and not os.path.exists("help"):
            rest = [*rest[1:2], "--help"]
            args = [*args[:first], *rest]
        refuse_unquoted(rest if rest[:1] and rest[0] not in self.commands else rest[1:])
        if rest and rest[0] not in self.commands and names_a_log(rest):
            args = [*args[:first], DEFAULT_COMMAND, *rest]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except OSError as error:
            if process.is_of_a_stream(error):  # Typer would end with 1 where the reader went away
                raise typer.Exit(process.report_lost_output(error)) from None
            raise


class Command(AsTyped, TyperCommand):
    """Command with sections in its help; it overwrites none of the files that it reads."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        args = [word for before, word in zip(["", *args], args, strict=False) if (before, word) != ("--json", "-")]
        if any("--summary" in option.opts for option in self.get_params(ctx)):
            args = [
                "--summary=-" if word == "--summary" and not after.endswith(".md") else word
                for word, after in zip(args, [*args[1:], ""], strict=True)
            ]
        self._refuse_option_as_value(ctx, args)
        return super().parse_args(ctx, args)

    def _refuse_option_as_value(self, ctx: Any, args: list[str]) -> None:
        """Raise UsageError for ``--estimates -o est``, which would be the value ``-o`` and the word ``est``."""
        params: list[Any] = self.get_params(ctx)
        options = {name: one for one in params for name in (*one.opts, *one.secondary_opts) if name.startswith("-")}
        words = args[: args.index("--")] if "--" in args else args
        for word, value in itertools.pairwise(words):
            option = options.get(word)
            if option is not None and not (option.is_flag or option.count) and value.partition("=")[0] in options:
                raise UsageError(f"{word}: has no value before {value}; write {word} {option.metavar or 'VALUE'}")

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        params: list[Any] = self.get_params(ctx)
        for parameter in params:
            if (record := parameter.get_help_record(ctx)) is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                title = COMMON if parameter.name == "help" else parameter.rich_help_panel or kind
                sections.setdefault(title, []).append((PYTHON_TYPE.sub("", record[0]), record[1]))
        sections[COMMON] = sections.pop(COMMON)  # last
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)

    def invoke(self, ctx: Any) -> Any:
        refuse_overwriting(str(self.name), ctx.params)
        if isinstance(ctx.obj, CommonOptions):  # options before the command
            ctx.params["quiet"] |= ctx.obj.quiet
            ctx.params["verbose"] += ctx.obj.verbose
        return super().invoke(ctx)


def names_a_log(words: list[str]) -> bool:
    """Return True for words without a command that name logs or options; a lone word is a mistyped command."""
    first = words[0]
    if first.startswith("-"):
        return len(words) > 1
    return any(c in first for c in "./\\*?") or os.path.exists(first)


def refuse_empty_words(words: list[str]) -> None:
    """Raise UsageError for an empty word: an unset variable of a script, which as a path is the current folder."""
    for before, word in zip(["", *words], words, strict=False):
        option = word.removesuffix("=") if word.startswith("--") and word.endswith("=") else ""
        if word == "" or option:
            after = option or (f"after {before}" if before else "")
            raise UsageError(f"an empty word {after}".rstrip() + "; is a variable not set?")


# Most words that a path with spaces is looked for in, and most words of a command line that is looked at.
MAX_PATH_WORDS, MAX_WORDS = 6, 100


def refuse_unquoted(words: list[str]) -> None:
    """Raise UsageError for words that a shell made of a path with spaces: ``my logs/a.bin``."""
    for k, word in enumerate(words[:MAX_WORDS]):
        if word.startswith("-") or os.path.lexists(word):
            continue
        for end in range(k + 2, min(len(words), k + MAX_PATH_WORDS) + 1):
            if os.path.lexists(path := " ".join(words[k:end])):
                raise UsageError(f'a path with spaces needs quotes: "{path}"')


def refuse_overwriting(command: str, params: Mapping[str, Any]) -> None:
    """Raise UsageError if a command would write a file that it reads, or a flight log.

    ``--junit flight.bin`` is a slip of the fingers, and a log cannot be flown again. Earlier reports are replaced.
    """
    read = [word for name, value in params.items() if name not in OUTPUT_OPTIONS for word in _words(value)]
    for name, option in OUTPUT_OPTIONS.items():
        if name != "output" or command in OUTPUT_IS_A_FILE:
            for path in _words(params.get(name)):
                refuse_file(option, path, read, logs=command != WRITES_LOGS)


def refuse_file(option: str, path: str, read: Iterable[str], *, logs: bool = True) -> None:
    """Raise UsageError if the file that ``option`` would write is one to read or, with ``logs``, a flight log."""
    if not os.path.isfile(path):
        return
    if any(os.path.isfile(word) and os.path.samefile(path, word) for word in read):
        raise UsageError(f"{option} {path}: is read by this command and would be overwritten; use another name")
    if logs and _is_log(path):
        raise UsageError(f"{option} {path}: is a flight log and would be overwritten; use another name")


def _words(value: Any) -> Iterator[str]:
    """Yield the texts of a parameter that may name files, those of a list of filters one by one."""
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


def command_line() -> str:
    """Return the command as typed, without secrets of URLs and the place of a private key: results are passed on."""
    from attlog.batch.remote import hide_secrets

    kept, words = ["attlog"], iter(sys.argv[1:])
    for word in words:
        if word == "--":
            kept += [word, *words]
        elif word == "--key":
            next(words, None)
        elif not word.startswith("--key="):
            kept.append(word)
    return hide_secrets(" ".join(kept))
