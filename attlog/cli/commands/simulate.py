"""``attlog simulate``: logs of a flown scenario; ``attlog reproduce``: experiments of papers, run again."""

from __future__ import annotations

import logging
import math
import os
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.arguments import command_line
from attlog.cli.options import CommonOptions, Folder, Jobs, JobsOfCores, Json, complete_scenarios
from attlog.cli.printing import GAP, TextLine, console, json_to_stdout, say, table, to_stderr, to_stdout, wrapped
from attlog.cli.progress import STAGES, progress
from attlog.core.errors import AttlogError, LogUnreadable, UsageError, missing_file

if TYPE_CHECKING:
    from attlog.reproduce.paper import Paper
    from attlog.simulate.scenario import Scenario


SUFFIXES = (".ulg", ".bin", ".tlog", ".mcap")


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Settings of a flight, and where its logs are written."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE|DIR",
            show_default=False,
            help="Write to this file (.ulg, .bin, .tlog, .mcap) or folder; repeat it for several logs of one flight.",
        ),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            min=0,
            metavar="N",
            show_default=False,
            help="Seed noise, bias and gusts; the same seed repeats the flight. [default: 0]",
        ),
    ] = None
    seeds: Annotated[
        str | None,
        typer.Option(
            "--seeds",
            metavar="1..20|1,5,9",
            show_default=False,
            help="Fly once for each seed and write SCENARIO-SEED.ulg to the folder of -o. [default: one flight]",
        ),
    ] = None
    kinds: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="ulg|bin|tlog|mcap",
            show_default=False,
            help="Write the logs in this format; repeat it for more. [default: ulg]",
        ),
    ] = None
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            metavar="NAME[@PRESET][:k=v,...]|truth",
            show_default=False,
            help="Fly on the attitude of this filter. [default: the scenario's]",
        ),
    ] = None
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            show_default=False,
            help="Set a value of the scenario, as in TOML: sensors.imu.0.gyro.bias_dps=[1,0,0]. May be repeated.",
        ),
    ] = None
    params: Annotated[
        list[str] | None,
        typer.Option(
            "--param",
            metavar="NAME=VALUE",
            show_default=False,
            help="Log this parameter instead, such as EKF2_MAG_DECL=20. May be repeated.",
        ),
    ] = None
    jobs: Jobs = 1
    listed: Annotated[bool, typer.Option("--list", help="List the scenarios.")] = False
    printed: Annotated[bool, typer.Option("--print", help="Print the scenario with every value as TOML.")] = False


def simulate_command(
    own: SimulationOptions,
    common: CommonOptions,
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            show_default=False,
            autocompletion=complete_scenarios,
            help="Fly this scenario of attlog, or TOML file. Without one they are listed.",
        ),
    ] = "",
) -> None:
    """Fly a scenario and write the logs of the flight.

    They are what an autopilot would have written, with truth.
    The same seed gives the same bytes. Without a SCENARIO those that come with attlog are listed.

    Example: attlog simulate hover -o hover.ulg
    """
    if own.listed or not scenario:
        if not own.listed and (own.output or own.seeds or own.estimator or own.settings or own.params or own.printed):
            raise UsageError("name a scenario; attlog simulate --list shows those that come with attlog")
        _list_scenarios()
        return
    flown = _scenario(scenario, own.settings or [], own.estimator)
    if not common.quiet:
        _warn(flown, scenario)
    if own.printed:
        from attlog.simulate.scenario_text import scenario_toml

        typer.echo(scenario_toml(flown), nl=False)
        return
    work = _files_of_seeds(flown.name, own.output or [], own.seeds, own.seed, own.kinds)
    logged = _parameters(own.params or [])
    from attlog.core.own_files import SIMULATED_LOG, require_replaceable
    from attlog.simulate.fly import plan_flights

    for path in (path for paths in work.values() for path in paths):
        require_replaceable(path, SIMULATED_LOG)

    with progress(common.quiet, common.verbose > 0) as shown:
        stage = logging.getLogger(STAGES)
        stage.info("flying %s, 1 of %d", flown.name, len(work))
        for number, (one, result) in enumerate(plan_flights(flown, work, logged, own.jobs), start=1):
            shown.clear()
            if isinstance(result, Exception):
                raise result
            for path, size in result if not common.quiet else ():
                to_stdout(f"{path}: {flown.seconds:g} s, seed {one}, {size / 1e6:.1f} MB")
            if number < len(work):
                stage.info("flying %s, %d of %d", flown.name, number + 1, len(work))


def _list_scenarios() -> None:
    """Print names and titles of the scenarios."""
    from attlog.simulate.scenario import load_scenario, scenario_names

    found = [load_scenario(name) for name in scenario_names()]
    width = max(len(one.name) for one in found)
    for one in found:
        to_stdout(f"{one.name:{width}}  {one.seconds:4g} s  {one.title}")
    if sys.stdout.isatty():
        to_stdout(f"\nattlog simulate {found[0].name} -o {found[0].name}.ulg writes one as a log.")


def _scenario(name: str, settings: list[str], estimator: str | None) -> Scenario:
    """Return the scenario with what the command line sets."""
    from attlog.simulate.scenario import build_scenario, scenario_path, scenario_values
    from attlog.simulate.scenario_text import override_values

    values = override_values(scenario_values(name), settings)
    if estimator is not None:
        values["estimator"] = {"name": estimator}
    return build_scenario(values, origin=scenario_path(name).name)


def _warn(flown: Scenario, name: str) -> None:
    """Print entries of a scenario without effect."""
    from attlog.simulate.scenario import scenario_path
    from attlog.simulate.scenario_text import ineffective_entries

    for sentence in ineffective_entries(flown):
        to_stderr(f"attlog: {scenario_path(name).name}: {sentence}")


def _files_of_seeds(
    name: str, output: list[Path], seeds: str | None, seed: int | None, kinds: list[str] | None
) -> dict[int, list[Path]]:
    """Return the logs to write of each seed. UsageError for options that contradict each other."""
    from attlog.simulate.scenario_text import parse_seeds as all_seeds

    wanted = [f".{kind.removeprefix('.').lower()}" for kind in kinds or ["ulg"]]
    for suffix in wanted:
        if suffix not in SUFFIXES:
            raise UsageError(f"--format {suffix.removeprefix('.')}: use ulg, bin, tlog or mcap")
    if not output:
        raise UsageError(f"say where to write: -o {name}.ulg (or .bin, .tlog, .mcap), or -o DIR")
    output = list(dict.fromkeys(output))
    folders = [path for path in output if os.path.isdir(path) or not path.suffix]
    for path in output:
        if path not in folders and path.suffix.lower() not in SUFFIXES:
            raise UsageError(f"-o {path}: the suffix names the format: .ulg, .bin, .tlog or .mcap")
    if seeds is not None and len(folders) < len(output):
        raise UsageError(f"--seeds {seeds} writes several logs: -o must be a folder")
    if kinds and not folders:
        raise UsageError("--format is for a folder; the suffix of a file names its format")
    if seeds is None:
        files = [path for path in output if path not in folders]
        return {seed or 0: [*files, *(folder / f"{name}{suffix}" for folder in folders for suffix in wanted)]}
    if seed is not None:
        raise UsageError("give --seed or --seeds")
    numbers = all_seeds(seeds)
    digits = len(str(max(numbers)))
    return {n: [folder / f"{name}-{n:0{digits}d}{suffix}" for folder in folders for suffix in wanted] for n in numbers}


def _parameters(words: list[str]) -> dict[str, float | int]:
    """Parse parameters by name; a number without a point is an integer."""
    found: dict[str, float | int] = {}
    for word in words:
        name, equals, text = word.partition("=")
        try:
            found[name.strip()] = int(text) if text.strip().lstrip("+-").isdecimal() else float(text)
        except ValueError:
            equals = ""
        if not equals or not name.strip() or not math.isfinite(found[name.strip()]):
            raise UsageError(f"--param {word}: write NAME=VALUE with a number, for example EKF2_MAG_DECL=20")
    return found


SEEDS = 20
MAX_COLUMNS = 110


def reproduce_command(
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
    from attlog.core.own_files import PAPER, require_replaceable
    from attlog.reproduce import page
    from attlog.reproduce.paper import PAPERS_WITH_LOGS, PaperOptions, paper_json, reproduce, select_papers

    if logs:  # a shell makes several words of --logs flights/*.ulg
        more = [word for word in papers if os.path.exists(word)]
        papers, logs = [word for word in papers if word not in more], [*logs, *map(Path, more)]
    names = select_papers(papers)
    errors: list[AttlogError] = []
    found_logs: list[Path] = []
    if logs:
        found_logs, errors = find(logs)
    errors += [LogUnreadable(f"{path}: {missing_file(str(path))}") for path in found_logs if not os.path.isfile(path)]
    if errors:
        raise errors[0]
    if found_logs and not PAPERS_WITH_LOGS & set(names):
        raise UsageError(f"--logs: only {', '.join(sorted(PAPERS_WITH_LOGS))} looks at logs, not {', '.join(names)}")
    for place in (output / f"reproduce-{name}.{suffix}" for name in names for suffix in ("html", "json")):
        require_replaceable(place, PAPER)
    options = PaperOptions(seeds, jobs or cores(), tuple(found_logs))
    for name in names:
        with progress(common.quiet, common.verbose > 0, lines=True) as shown:
            shown.before = f"{name}: "
            found = reproduce(name, options, command_line())
            place = output / f"reproduce-{name}.html"
            write_all_atomic(
                {place: page.render_paper(found), place.with_suffix(".json"): paper_json(found, indent=1)}, PAPER
            )
        if json:
            json_to_stdout(paper_json(found))
        if not common.quiet:
            out = console(stderr=json)
            say(paper_lines(found, place, common.verbose > 0, out.width), out)


def paper_lines(paper: Paper, place: Path, verbose: bool = False, width: int = 80) -> Iterator[TextLine]:
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
