"""``attlog reproduce``: what the papers found, run again."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.arguments import command_line
from attlog.cli.options import CommonOptions, Folder, JobsOfCores, Json
from attlog.cli.printing import GAP, TextLine, console, json_to_stdout, say, table, wrapped
from attlog.cli.progress import progress
from attlog.core.errors import AttlogError, LogUnreadable, UsageError

if TYPE_CHECKING:
    from attlog.reproduce.paper import Paper

SEEDS = 20
MAX_COLUMNS = 110


def command(
    papers: Annotated[
        list[str],
        typer.Argument(
            metavar="lyu|fan|huang|xu|all...", show_default=False, help="Run the experiments of these papers."
        ),
    ],
    common: CommonOptions,
    output: Folder = Path("reports"),
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="Fly N simulated flights for each number.")
    ] = SEEDS,
    logs: Annotated[
        list[Path] | None,
        typer.Option(
            "--logs",
            metavar="LOG|DIR|GLOB",
            readable=False,
            help="Take these real flights for the paper that has some (xu); may be repeated. "
            "[default: sample_logs of the source]",
        ),
    ] = None,
    jobs: JobsOfCores = None,
    json: Json = False,
) -> None:
    """Run the experiments of four papers again.

    Each claim of a paper gets a verdict: by how much, over how many flights.

    Example: attlog reproduce lyu --seeds 20
    """
    from attlog.batch.sources import find
    from attlog.core.files import write_all_atomic
    from attlog.core.machine import cores
    from attlog.reproduce import page
    from attlog.reproduce.paper import PAPERS_WITH_LOGS, PaperOptions, paper_json, reproduce, select_papers

    names = select_papers(papers)
    errors: list[AttlogError] = []
    found_logs: list[Path] = []
    if logs:
        found_logs, errors = find(logs)
    errors += [LogUnreadable(f"{path}: there is no such file") for path in found_logs if not os.path.isfile(path)]
    if errors:
        raise errors[0]
    if found_logs and not PAPERS_WITH_LOGS & set(names):
        raise UsageError(f"--logs: only {', '.join(sorted(PAPERS_WITH_LOGS))} looks at logs, not {', '.join(names)}")
    options = PaperOptions(seeds, jobs or cores(), tuple(found_logs))
    for name in names:
        with progress(common.quiet, common.verbose > 0, lines=True) as shown:
            shown.before = f"{name}: "
            found = reproduce(name, options, command_line())
            place = output / f"reproduce-{name}.html"
            write_all_atomic({place: page.render_paper(found), place.with_suffix(".json"): paper_json(found, indent=1)})
        if json:
            json_to_stdout(paper_json(found))
        if not common.quiet:
            out = console(stderr=json)
            say(printed(found, place, common.verbose > 0, out.width), out)


def printed(paper: Paper, place: Path, verbose: bool = False, width: int = 80) -> Iterator[TextLine]:
    """Yield the claims of a paper as a table; ``verbose``: then reasons, methods and all numbers."""
    from attlog.reproduce.page import number_text
    from attlog.reproduce.paper import tally_verdicts
    from attlog.words.text import typeset

    width = min(width, MAX_COLUMNS)
    half = (width - len("cannot be judged") - 2 * len(GAP)) // 2
    rows, details = [], []
    for number, claim in enumerate(paper.claims, 1):
        says = f"{number}. {typeset(claim.says)} ({claim.where}{f': {typeset(claim.paper)}' if claim.paper else ''})"
        ours = [f"{number_text(n)}: {typeset(n.what)}" for n in claim.numbers[: claim.shown]]
        rows.append((_broken([says], half), _broken(ours, half), claim.verdict))
        details += [f"{number}. {typeset(claim.by)}", typeset(claim.measured)]
        details += [f"{typeset(n.what)}: {number_text(n)}" for n in claim.numbers]
    yield TextLine(f"{paper.key}: {paper.title}", "bold")
    head = ("The paper says", _broken(["Ours (95 % interval; flights)"], half), "Verdict")
    yield from table(rows, head, left=range(3))
    for text in details if verbose else ():
        yield from wrapped("" if text[:1].isdigit() else "   ", text, width)
    yield TextLine(tally_verdicts(paper))
    yield TextLine(f"page: {place}")


def _broken(texts: list[str], width: int) -> str:
    return "\n".join(line for text in texts for line in textwrap.wrap(text, width, break_on_hyphens=False))
