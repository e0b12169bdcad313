"""``attlog info``: what is in a log, whether physics agrees, what can be answered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import typer

from attlog import __version__
from attlog.cli.options import Boot, CommonOptions, Json, Logs, System
from attlog.cli.printing import TextLine, columns, console, json_line, json_to_stdout, say, to_stderr, wrapped
from attlog.core.errors import EXIT_BUG, error_message, exit_code, worst_exit_code

STYLES = {"ok": "", "warning": "yellow", "fault": "red", "unknown": "dim"}


def command(
    logs: Logs,
    common: CommonOptions,
    json: Json = False,
    boot: Boot = None,
    system: System = None,
) -> None:
    """Say what is in a log and what it can answer.

    Each LOG is checked against physics. What is missing is listed with the setting that would log it.

    Example: attlog info flight.ulg
    """
    from attlog.batch.sources import find
    from attlog.cli.process import is_of_a_stream
    from attlog.pipeline.inspection import inspect

    found, wrong = find(logs)
    codes = {exit_code(error) for error in wrong}
    for error in wrong:
        to_stderr(error_message(error, __version__))
    for number, log in enumerate(found):
        try:
            report = inspect(log, boot=boot, system=system)
            if json:
                json_to_stdout(json_line(report))
            elif not common.quiet:
                out = console()
                say([TextLine("")] * (number > 0), out)
                say(lines(printable(report), out.width, common.verbose), out)
        except Exception as error:
            if is_of_a_stream(error) or (common.verbose > 1 and exit_code(error) == EXIT_BUG):
                raise
            to_stderr(error_message(error, __version__, str(log)))
            codes.add(exit_code(error))
    if worst_exit_code(codes):
        raise typer.Exit(worst_exit_code(codes))


def printable(report: dict[str, Any]) -> dict[str, Any]:
    """The report without what a stranger's log could do to a terminal; strange bytes of a file name as escapes."""
    from attlog.words.text import cleaned, encodable

    name = encodable(report["log"]["name"], "utf-8")
    safe: dict[str, Any] = cleaned(report | {"log": report["log"] | {"name": name}})
    return safe


def lines(report: dict[str, Any], width: int, verbose: int = 0) -> Iterator[TextLine]:
    """What ``inspection.inspect`` found as text of at most ``width`` columns where words can be broken."""
    from attlog.cli.tables import wrong
    from attlog.health.causes import Finding
    from attlog.metrics.gyro_bias import CommonBias
    from attlog.words.findings import shown_findings
    from attlog.words.flight import bias_sentence as said_bias

    yield from _head(report["log"], width)
    if report["headline"]:
        yield TextLine("")
        yield from wrapped("", report["headline"], width)
    checks = [(c["name"], c["verdict"], c["text"]) for c in report["audit"]]
    yield from _part("Physics", checks, width, [STYLES[c["verdict"]] for c in report["audit"]])
    questions = report["answerable"]
    answers = [
        (
            q["question"].replace("_", " "),
            "yes" if q["can"] else "no",
            " ".join(x for x in (q["reason"], q["setting"]) if x),
        )
        for q in questions
    ]
    yield from _part("What can be answered", answers, width, ["" if q["can"] else "red" for q in questions])
    taken = [(f"gyro of {bias['imu']}", said_bias(CommonBias(**bias))) for bias in report["gyro_bias"] or []]
    yield from _part("What analyze does to every filter alike", taken, width, [""] * len(taken))
    if report["compared_with"]:
        yield from _part("Compared with", [("reference", "", report["compared_with"])], width, [""])
    yield TextLine("")
    found = [Finding(**f) for f in report["findings"]]
    yield from wrong(shown_findings(found), str, width, bool(verbose))
    messages = [
        (
            m["name"] + (f".{m['instance']}" if m["instance"] else ""),
            f"{m['records']:>7} records",
            "" if m["rate_hz"] is None else f"{m['rate_hz']:>8.2f} Hz",
            f"{m['fields']:>3} fields",
        )
        for m in report["messages"]
    ]
    yield from _part("Messages", messages, width, [""] * len(messages))


def _head(log: dict[str, Any], width: int) -> Iterator[TextLine]:
    """Which file, vehicle, firmware, when, how long; the sensors and why they were chosen."""
    firmware = " ".join(x for x in (log["firmware"]["name"], log["firmware"]["version"]) if x) or "unknown firmware"
    yield TextLine(f"{log['name']}  {log['format']}, {log['size'] / 1e6:.1f} MB, sha256 {log['sha256'][:12]}", "bold")
    yield TextLine(f"{log['vehicle'] or 'unknown vehicle'}, {firmware}{', simulated' if log['simulated'] else ''}")
    boots = f", boot {log['boot']} of {log['boots']}" if log["boots"] > 1 else ""
    yield TextLine(f"{log['date_utc'] or 'date unknown'}, {log['duration_s']:.1f} s{boots}")
    sensors = []
    for what in ("imu", "mag", "attitude", "truth"):
        sensor = log[what]
        found = "none" if sensor is None else f"{sensor['source']} at {sensor['rate_hz']:.1f} Hz"
        if what == "truth" and log["poses"]:
            found += f"; --truth takes {', '.join(log['poses'])}"
        reason = log["choices"].get(what, "")
        sensors.append((what, found + (f". {reason.rstrip('.')}." if reason else "")))
    yield from (TextLine(line) for row in columns(sensors, width) for line in row)
    if log["seconds"]:
        yield TextLine(
            "  " + ", ".join(f"{k} {'unknown' if s is None else f'{s:.1f} s'}" for k, s in log["seconds"].items())
        )


def _part(title: str, rows: Sequence[tuple[str, ...]], width: int, styles: list[str]) -> Iterator[TextLine]:
    """A titled table; nothing without rows."""
    if rows:
        yield TextLine("")
        yield TextLine(title, "bold")
        for laid, style in zip(columns(rows, width), styles, strict=True):
            yield from (TextLine(line, style) for line in laid)
