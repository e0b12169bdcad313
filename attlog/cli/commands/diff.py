"""``attlog diff``: what changed between two runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from attlog import __version__
from attlog.cli.arguments import command_line
from attlog.cli.logs import end
from attlog.cli.options import CommonOptions, Json, one_form
from attlog.cli.printing import console, say, to_stderr
from attlog.core.errors import UsageError, error_message

if TYPE_CHECKING:
    from attlog.compare.diff import RunDifference


def command(
    old: Annotated[
        Path,
        typer.Argument(metavar="OLD", show_default=False, help="Compare this result of analyze, or folder of results."),
    ],
    new: Annotated[
        Path, typer.Argument(metavar="NEW", show_default=False, help="Compare it with these of a newer run.")
    ],
    common: CommonOptions,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE|PCT%",
            help="Let a metric move so far: lag_ms=2, noise_*=5%. [default: 2 %, or a small step of its unit]",
        ),
    ] = None,
    window: Annotated[
        str | None, typer.Option(metavar="W", help="Compare the numbers of this window. [default: every window]")
    ] = None,
    form: Annotated[
        Literal["md"] | None,
        typer.Option("--format", metavar="md", help="Print the table as Markdown. [default: for reading]"),
    ] = None,
    json: Json = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="Write a page and its JSON into this folder; with --format or --json this file. [default: print]",
        ),
    ] = None,
) -> None:
    """Compare two results, or two folders of them.

    What is told otherwise and numbers beyond their tolerance are printed, worst first, then parameters and gains.
    Exit code 1: something changed.

    Example: attlog diff reports-old reports-new --tolerance lag_ms=2
    """
    one_form(json, form)
    from json import dumps

    from attlog.compare import diff_report
    from attlog.compare.diff import compare_results, metric_units, pair_results, parse_tolerances

    found = pair_results(old, new)
    for error in found.wrong:
        to_stderr(error_message(error, __version__))
    results = [r for pair in found.pairs.values() for r in pair if r is not None]
    windows = {w for r in results for row in r.estimators for w in row.metrics}
    if window is not None and window not in windows and results:
        raise UsageError(f"--window {window}: no result has it; they have {', '.join(sorted(windows))}")
    limits = parse_tolerances(tolerance or [], metric_units(*results))
    differences = [
        compare_results(name, a, b, limits, window)
        for name, (a, b) in found.pairs.items()
        if a is not None and b is not None
    ]
    alone = found.alone
    changed = bool(alone) or any(d.count for d in differences)
    paged = output is not None and not json and form is None
    if json:
        lines = dumps(diff_report.diff_document(differences, alone), indent=1, allow_nan=False).split("\n")
    else:
        words = diff_report.diff_lines if form is None else diff_report.diff_markdown
        lines = list(words(differences, alone, common.verbose > 0))
    if output is not None and paged:
        lines += ["", f"page: {_page(differences, alone, (old, new), output)}"]
    _write(lines, None if paged else output)
    end([*found.wrong, int(changed)])


def _page(
    differences: list[RunDifference], alone: list[tuple[str, str]], sides: tuple[Path, Path], folder: Path
) -> Path:
    """The page and the JSON, written together."""
    from json import dumps

    from attlog.compare import diff_report
    from attlog.core.files import write_all_atomic

    whole = dumps(diff_report.diff_document(differences, alone), indent=1, allow_nan=False) + "\n"
    same = sides[0].name == sides[1].name
    names = [f"{side.parent.name}/{side.name}" if same else side.name for side in sides]
    page = diff_report.diff_page(differences, alone, names[0], names[1], __version__, command_line())
    write_all_atomic({folder / "diff.html": page, folder / "diff.json": whole})
    return folder / "diff.html"


def _write(lines: list[str], output: Path | None) -> None:
    if output is None:
        say(lines, console())
        return
    from attlog.core.files import write_atomic

    write_atomic(output, "\n".join(lines) + "\n")
