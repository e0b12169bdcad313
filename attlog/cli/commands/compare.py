"""``attlog compare``: configurations on one log or on many, by paired differences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog import __version__
from attlog.base.errors import PluginError, PluginTimeout, UsageError, exit_code, message, worst
from attlog.base.file_names import file_name
from attlog.cli.shared import completion
from attlog.cli.shared.arguments import command_line
from attlog.cli.shared.options import FilterTimeout, check_window
from attlog.cli.shared.printing import Json, NoColor, Quiet, Verbose, console, json_to_stdout, say, to_stderr
from attlog.cli.shared.progress import progress

if TYPE_CHECKING:
    from attlog.cli.shared.printing import Line
    from attlog.compare.differences.comparison import Comparison
    from attlog.compare.differences.one_log import LogComparison


def command(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG... CONFIGURATION...",
            show_default=False,
            help="Logs, folders, patterns; NAME[@PRESET][:key=value,...], FILE.py, filters.toml, estimate.csv.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page and JSON.")] = Path(
        "reports"
    ),
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="What the files are called.")] = "compare",
    jobs: Annotated[int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Measure so many logs at a time.")] = 1,
    table: Annotated[
        list[Path] | None,
        typer.Option("--table", metavar="FILE.csv|tex|md", help="Write the tables to a file too; may be repeated."),
    ] = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            "--metric", metavar="ID|all", help="Compare by this metric; may be repeated. [default: the main ones]"
        ),
    ] = None,
    params: Annotated[
        Path | None,
        typer.Option(
            "--params",
            metavar="NEW.param",
            help="Also run the firmware's own filters with the parameters of this file.",
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W",
            autocompletion=completion.windows,
            help="Look here only: all, rest, airborne, hover, cruise, ... or T0:T1 (s). [default: by question]",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(metavar="R", autocompletion=completion.references, help="As of analyze. [default: auto]"),
    ] = None,
    gyro_bias: Annotated[
        str | None, typer.Option(metavar="rest|none|onboard", help="As of analyze. [default: rest]")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="F.toml|F.json", help="Options of analyze from a file. [default: none]")
    ] = None,
    plotly: Annotated[str, typer.Option(metavar="inline|shared", help="shared: plotly.js beside the page.")] = "inline",
    json: Json = False,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    filter_timeout: FilterTimeout = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Compare configurations on each LOG with the first of them: ratios and differences, pooled over logs."""
    if plotly not in ("inline", "shared"):
        raise UsageError(f"--plotly {plotly}: use inline or shared")
    if file_name(name) != name:
        raise UsageError(f"--name {name!r}: no name of a file in the folder of -o; such as {file_name(name)}")
    check_window(window)
    from attlog.compare.configurations.command_words import sorted_out, with_params
    from attlog.compare.differences.compare import compare
    from attlog.compare.tables.files import check_suffix

    for file in table or []:
        check_suffix(file)
    found = sorted_out(words)
    configurations = with_params(found.wanted.configurations, params) if params else found.wanted.configurations
    if found.again and len(configurations) < 2:
        raise UsageError(f"{found.again[0]}; a comparison needs two that differ")
    for sentence in found.again:
        to_stderr(f"attlog: {sentence}; it is compared once")
    options = {"window": window, "reference": reference, "gyro_bias": gyro_bias}
    settings = _settings(config, found.wanted.options | {k: v for k, v in options.items() if v is not None})
    from attlog.fleet.sources.find import find

    logs, wrong = find(found.logs)
    if not found.logs:
        raise UsageError("no log named: attlog compare LOG... mahony:kp=0.3 mahony:kp=0.6")
    for error in wrong:
        to_stderr(message(error, __version__))
    done = 0
    codes: set[int] = set()
    with progress(quiet, verbose > 0) as shown:

        def tell(one: LogComparison) -> None:
            nonlocal done
            done += 1
            shown.clear()
            for sentence in one.late:
                codes.add(PluginTimeout.exit_code)
                to_stderr(f"attlog: {one.line.path}: {sentence}")
            if one.nothing_ran and not one.late:
                codes.add(PluginError.exit_code)
                to_stderr(f"attlog: {one.line.path}: no configuration ran: {one.nothing_ran}")
            if one.line.code:
                to_stderr(one.trace * (verbose > 1) + f"attlog: {one.line.path}: {one.line.reason}")
            shown.before = f"[{min(done + 1, len(logs))}/{len(logs)}] "

        shown.before = f"[1/{len(logs)}] "
        result = None
        if logs:
            result = compare(
                logs,
                configurations,
                settings,
                metrics=metric or found.wanted.metrics,
                jobs=jobs,
                command=command_line(),
                tell=tell,
            )
    codes |= {exit_code(error) for error in wrong}
    if result is not None:
        codes |= {line.code for line in result.logs}
        page = _written(result, output, name, "shared" if plotly == "shared" else "inline", table or [])
        if json:
            json_to_stdout(result.to_json())
        if not quiet:
            out = console(stderr=json)
            say(printed(result, out.width, verbose > 0), out)
            say(_places(page, table or []), out)
        if open_page:
            typer.launch(str(page))
    if worst(codes):
        raise typer.Exit(worst(codes))


def _settings(path: Path | None, options: dict[str, Any]) -> Any:
    from attlog.config import Config

    return Config.build(options) if path is None else Config.load(path, **{"estimators": ["default"]} | options)


def _written(result: Comparison, folder: Path, name: str, plotly: Any, files: list[Path]) -> Path:
    from attlog.base.output import write_together
    from attlog.compare.tables import comparison_page, export

    place = folder / f"{name}.html"
    tables = {file: export.text(result, file) for file in (folder / f"{name}.csv", *files)}
    write_together(
        comparison_page.files(result, place, plotly=plotly) | {folder / f"{name}.json": result.to_json(), **tables}
    )
    return place


def printed(result: Comparison, width: int, verbose: bool = False) -> Iterator[Line]:
    """Sentences and tables on the terminal, at most ``width`` columns wide where words can be broken.

    ``verbose`` tells why a log has no difference.
    """
    from attlog.cli.shared.printing import Line, wrapped
    from attlog.compare.tables.table import tables
    from attlog.present.text import clean, typeset

    for verdict in result.verdicts:
        yield from (Line(line.text, "bold") for line in wrapped("", typeset(clean(verdict.lead)), width))
        for text in verdict.more:
            yield from wrapped("  ", typeset(clean(text)), width)
        yield Line("")
    for table in tables(result):
        if not any(row[3] for row in table.rows):
            continue
        yield Line(f"{table.title} ({table.caption})", "bold")
        rows = [table.head, *table.rows]
        cells = [[clean(cell) for cell in row] for row in rows]
        widths = [max(len(row[i]) for row in cells) for i in range(len(table.head))]
        for row in cells:
            parts = [
                c.ljust(w) if i in (0, len(row) - 1) else c.rjust(w)
                for i, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            yield Line(("  " + "  ".join(parts)).rstrip())
        for reason in dict.fromkeys(r for r in table.reasons if r and verbose):
            yield from wrapped("  – ", typeset(clean(reason)), width)
        yield Line("")
    broken = [line for line in result.logs if line.code]
    for line in broken:
        yield from wrapped("not used: ", clean(f"{line.name}: {line.reason}"), width)


def _places(page: Path, tables: list[Path]) -> Iterator[Line]:
    from attlog.cli.shared.printing import Line

    yield Line(f"page: {page}")
    for file in tables:
        yield Line(f"table: {file}")
