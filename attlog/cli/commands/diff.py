"""``attlog diff``: what changed between two runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.base.errors import UsageError, exit_code, message, worst
from attlog.cli.shared.printing import NoColor, Verbose, console, say, to_stderr

if TYPE_CHECKING:
    from attlog.compare.diff.diff import RunDifference
    from attlog.compare.diff.result_files import ResultPairs

FORMATS = ("table", "markdown", "json")


def command(
    old: Annotated[Path, typer.Argument(metavar="OLD", show_default=False, help="A JSON of analyze, or a folder.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", show_default=False, help="The same of the newer run.")],
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE|PCT%",
            help="How far a metric may move: lag_ms=2, noise_*=5%. [default: 2 %, or a small step of its unit]",
        ),
    ] = None,
    window: Annotated[
        str | None, typer.Option(metavar="W", help="Compare the numbers of this window only. [default: every window]")
    ] = None,
    form: Annotated[str, typer.Option("--format", metavar="table|markdown|json", help="How to print it.")] = "table",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it to a file. [default: print it]")
    ] = None,
    no_color: NoColor = False,
    verbose: Verbose = 0,
) -> None:
    """Compare two results, or two folders of them: numbers beyond their tolerance, changed parameters, rows, logs."""
    if form not in FORMATS:
        raise UsageError(f"--format {form}: use {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    from attlog.compare.diff import diff, result_files
    from attlog.compare.diff.tolerance import tolerances

    found = result_files.found(old, new)
    for error in found.wrong:
        to_stderr(message(error, __version__))
    results = [r for pair in found.pairs.values() for r in pair if r is not None]
    windows = {w for r in results for row in r.estimators for w in row.metrics}
    if window is not None and window not in windows and results:
        raise UsageError(f"--window {window}: no result has it; they have {', '.join(sorted(windows))}")
    limits = tolerances(tolerance or [], diff.units_of(*results))
    differences = [
        diff.difference(name, a, b, limits, window)
        for name, (a, b) in found.pairs.items()
        if a is not None and b is not None
    ]
    count = sum(d.count for d in differences) + len(_alone(found))
    _tell(differences, found, form, output, bool(verbose))
    code = worst([exit_code(error) for error in found.wrong] + [1 if count else 0])
    if code:
        raise typer.Exit(code)


def _alone(found: ResultPairs) -> list[tuple[str, str]]:
    """Logs that one side has alone, and which side."""
    return [(n, "new" if a is None else "old") for n, (a, b) in found.pairs.items() if a is None or b is None]


def _tell(
    differences: list[RunDifference], found: ResultPairs, form: str, output: Path | None, everything: bool
) -> None:
    import json

    from attlog.cli.shared.printing import Line
    from attlog.compare.diff import text as diff_words

    alone = _alone(found)
    if form == "json":
        texts = json.dumps(diff_words.document(differences, alone), indent=1, allow_nan=False).split("\n")
    else:
        words = diff_words.markdown if form == "markdown" else diff_words.lines
        texts = list(words(differences, alone, everything))
    if output is None:
        say(map(Line, texts), console())
        return
    from attlog.base.output import write_atomic

    write_atomic(output, "\n".join(texts) + "\n")
