"""``attlog info``: what is in a log, whether physics agrees, what can be answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.common import Boot, Log, NoColor, Quiet, System, Verbose, console, existing

if TYPE_CHECKING:
    from rich.console import Console

MARKS = {
    "good": "[green]good[/]",
    "warn": "[yellow]warn[/]",
    "bad": "[red]bad[/]",
    "cannot_judge": "[dim]cannot judge[/]",
}


def command(
    log: Log,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Read the log again with pyulog or pymavlink and compare every value.")
    ] = False,
    boot: Boot = None,
    system: System = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Say what is in LOG, check it against physics, and tell which questions it can answer."""
    from attlog.inspection import inspect

    existing(log)
    report = inspect(log, boot=boot, system=system, verify=verify)
    if as_json:
        import json

        typer.echo(json.dumps(report, ensure_ascii=False, indent=1, allow_nan=False))
    elif not quiet:
        from attlog.present.text import cleaned

        _show(cleaned(report), console(), verbose)
    if verify and not report["verify"]["agrees"]:
        raise typer.Exit(1)


def _show(report: dict[str, Any], out: Console, verbose: int) -> None:
    from rich.markup import escape
    from rich.table import Table

    log = report["log"]
    firmware = " ".join(x for x in (log["firmware"]["name"], log["firmware"]["version"]) if x) or "unknown firmware"
    out.print(
        f"[bold]{escape(log['name'])}[/]  {log['format']}, {log['size'] / 1e6:.1f} MB, sha256 {log['sha256'][:12]}"
    )
    simulated = ", simulated" if log["simulated"] else ""
    out.print(escape(f"{log['vehicle'] or 'unknown vehicle'}, {firmware}{simulated}"))
    when = log["date_utc"] or "date unknown"
    boots = f", boot {log['boot']} of {log['boots']}" if log["boots"] > 1 else ""
    out.print(f"{when}, {log['duration_s']:.1f} s{boots}")
    for what in ("imu", "mag", "attitude", "truth"):
        sensor = log[what]
        reason = log["choices"].get(what, "")
        line = "none" if sensor is None else f"{sensor['source']} at {sensor['rate_hz']:.1f} Hz"
        out.print(f"  {what:<9} {escape(line)}" + (f"  [dim]{escape(reason)}[/]" if reason else ""))
    if log["seconds"]:
        told = (f"{k} {'unknown' if s is None else f'{s:.1f} s'}" for k, s in log["seconds"].items())
        out.print("  " + ", ".join(told))

    if report["audit"]:
        table = Table(
            "check", "verdict", "what was seen", box=None, pad_edge=False, title="Physics", title_justify="left"
        )
        for check in report["audit"]:
            table.add_row(check["name"], MARKS[check["verdict"]], escape(check["text"]))
        out.print(table)
    if report["answerable"]:
        table = Table(
            "question", "", "why", box=None, pad_edge=False, title="What can be answered", title_justify="left"
        )
        for item in report["answerable"]:
            why = " ".join(x for x in (item["reason"], item["setting"]) if x)
            table.add_row(item["question"], "[green]yes[/]" if item["can"] else "[red]no[/]", escape(why))
        out.print(table)
    problems = [p for p in report["problems"] if verbose or p["severity"] != "info"]
    if problems:
        out.print("[bold]Problems[/]")
        for p in problems:
            since = "" if p["t"] is None else f" (from {p['t']:.1f} s on)"
            out.print(f"  {p['severity']}: {escape(p['text'])}{since}")
    if verbose:
        table = Table(
            "message", "instance", "records", "fields", box=None, pad_edge=False, title="Messages", title_justify="left"
        )
        for m in report["messages"]:
            table.add_row(escape(m["name"]), str(m["instance"]), str(m["records"]), str(m["fields"]))
        out.print(table)
    if report["verify"] is not None:
        v = report["verify"]
        out.print(f"[bold]{'Agrees' if v['agrees'] else 'Differs from'}[/] with {v['oracle']}: {escape(v['text'])}")
        for line in v["differences"]:
            out.print(f"  {escape(line)}")
