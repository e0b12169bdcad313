"""``attlog check-estimator``: the public conformance suite on one filter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.common import NoColor, Quiet, console

if TYPE_CHECKING:
    from attlog.testing import Outcome


def command(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE.py", help="A registered estimator, or the file of one.")],
    no_color: NoColor = False,
    quiet: Quiet = False,
) -> None:
    """Run every check that applies to a filter: signs, convergence, frames, bad input. Exit code 1 if one fails."""
    from rich.markup import escape

    from attlog.testing import check_estimator, speed_ns

    out = console()

    def show(outcome: Outcome) -> None:
        mark = "[green]passed[/]" if outcome.passed else "[red]failed[/]"
        if not (quiet and outcome.passed):
            out.print(f"{mark}  {escape(outcome.name)}" + (f": {escape(outcome.message)}" if outcome.message else ""))

    outcomes = check_estimator(name, report=show)
    failed = sum(not o.passed for o in outcomes)
    if not quiet:
        out.print(f"{len(outcomes) - failed} passed, {failed} failed; {speed_ns(name):.0f} ns per update")
    if failed:
        raise typer.Exit(1)
