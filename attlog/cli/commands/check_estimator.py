"""``attlog check-estimator``: does a filter keep the contract?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli import options
from attlog.cli.printing import terminal

if TYPE_CHECKING:
    from attlog.testing import CheckOutcome

FAILED = 1
Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME|FILE.py",
        autocompletion=options.complete_filters,
        help="Check this filter; @PRESET and :k=v may follow.",
    ),
]


def command(name: Name) -> None:
    """Check that a filter keeps the contract.

    The exit code is 1 if a check fails.

    Example: attlog check-estimator my_filter.py
    """
    from attlog.estimators import parse
    from attlog.testing import about, check_estimator, speed_ns
    from attlog.words.text import for_terminal

    out = terminal()
    subject = parse(name)
    for line in about(subject):
        out.print(f"note  {line}", markup=False, soft_wrap=True)

    def show(outcome: CheckOutcome) -> None:
        mark = "[green]pass[/]" if outcome.passed else "[red]FAIL[/]"
        out.print(f"{mark}  {outcome.name.replace('_', ' ').replace('[', ' in ').replace(']', '')}", soft_wrap=True)
        if not outcome.passed:
            out.print(f"      {for_terminal(outcome.message)}", style="dim", markup=False, soft_wrap=True)

    outcomes = check_estimator(subject, show)
    failed = sum(not o.passed for o in outcomes)
    if failed:
        out.print(f"\n{name}: {failed} of {len(outcomes)} checks failed.", markup=False)
        raise typer.Exit(FAILED)
    out.print(f"\n{name}: all {len(outcomes)} checks passed; {speed_ns(subject):.0f} ns per update.", markup=False)
