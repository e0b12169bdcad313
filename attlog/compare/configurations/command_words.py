"""Which words of a command line are logs, and which are configurations? Known by what they look like."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from attlog import estimators
from attlog.base.errors import AttlogError, UsageError, suggestion
from attlog.compare.configurations import toml_file
from attlog.compare.configurations.configuration import Configuration, parse
from attlog.flight.calibration.recorrection import calibrates
from attlog.flight.parameters.file import read_file

KEYS = re.compile(r"[^:]*:[A-Za-z_]\w*=")


@dataclass(slots=True)
class ComparisonRequest:
    """Logs (files, folders, patterns) and configurations, in the order given, with what a TOML file asks for."""

    logs: list[Path] = field(default_factory=list)
    again: list[str] = field(default_factory=list)
    """Sentences on words that name a configuration which another word names already."""
    wanted: toml_file.ConfigurationFile = field(default_factory=toml_file.ConfigurationFile)


def sorted_out(words: Sequence[str]) -> ComparisonRequest:
    """The logs and configurations of a command line. UsageError tells everything wrong with the configurations.

    A configuration is a filter's name, alone or with ``@`` or ``:``, a ``.py`` or ``.csv`` file, or a ``.toml`` file of
    them; everything else is a log. A file that is called like a filter is meant with ``./`` before it.
    """
    found, filters = ComparisonRequest(), frozenset(estimators.names())
    problems: list[str] = []
    names: dict[str, Configuration] = {}
    as_given: dict[str, str] = {}
    worst = UsageError.exit_code
    for word in words:
        try:
            if word.lower().endswith(".toml"):
                wanted = toml_file.read(Path(word))
                found.wanted.metrics += wanted.metrics
                found.wanted.options |= wanted.options
                for one in wanted.configurations:
                    names.setdefault(one.name, one)
            elif is_configuration(word, filters):
                one = parse(word)
                if one.name in names:
                    other = as_given.get(one.name, one.name)
                    found.again.append(
                        f"{word} is given twice" if word == other else f"{word} is the same configuration as {other}"
                    )
                as_given.setdefault(one.name, word)
                names.setdefault(one.name, one)
            elif not os.path.exists(word) and not set("*?[/\\.") & set(word):
                known = [*estimators.names(), "default", "all"]
                problems.append(f"{word}: neither a file nor a filter{suggestion(word, known)}")
            else:
                found.logs.append(Path(word))
        except AttlogError as error:
            problems.append(str(error))
            worst = error.exit_code
    if problems:
        refused = UsageError("\n".join(problems))
        refused.exit_code = worst if len(problems) == 1 else UsageError.exit_code
        raise refused
    found.wanted.configurations = list(names.values())
    return found


def is_configuration(word: str, filters: Collection[str]) -> bool:
    """Whether a word names one of the filters, an estimator file or an estimate, not a log."""
    head = re.split(r"[@:]", word, maxsplit=1)[0]
    if head in filters or re.search(r"\.(py|csv)(@|:|$)", word, re.IGNORECASE):
        return True
    return not os.path.exists(word) and (KEYS.match(word) is not None or ("@" in word and "/" not in word))


def with_params(configurations: Sequence[Configuration], path: Path) -> list[Configuration]:
    """The configurations, and behind each whose filter takes firmware parameters the same with those of a file.

    Where the file calibrates a compass or an accelerometer every filter takes it: its samples are others.
    Without any configuration the filter stands in that replays a firmware's own estimator and whose parameters are in
    the file. UsageError where no filter takes such parameters; errors of reading the file as they come.
    """
    set_there = set(read_file(path))
    named = list(configurations)
    if not named:
        replicas = [parse(name) for name in REPLICAS if name in estimators.names()]
        named = [c for c in replicas if set_there & {p.name for p in c.row.estimator.parameters}]
    samples = calibrates(set_there)
    runs = [c for c in named if "params" not in c.before and not estimators.is_recorded(c.row.estimator.origin)]
    taking = [c for c in runs if samples or c.row.estimator.from_log is not None]
    if not taking or (not configurations and len(named) > 1):
        which = ", ".join(n for n in REPLICAS if n in estimators.names())
        raise UsageError(
            f"--params {path}: name a filter that takes these parameters ({which}); "
            f"{'none of the configurations does' if configurations else 'the file does not say which'}"
        )
    found: dict[str, Configuration] = {}
    for c in named:
        found[c.name] = c
        if c in taking:
            new = c.with_value("params", str(path), None if c.name == c.text else f"{c.name}, {path.name}")
            found[new.name] = new
    return list(found.values())


REPLICAS = ("px4_q", "ap_dcm")
"""Filters that replay a firmware's own estimator with its own parameters."""
