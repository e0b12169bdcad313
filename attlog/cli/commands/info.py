"""``attlog info``: what is in a log, whether physics agrees, what can be answered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from attlog.cli.logs import end, named_files, reported
from attlog.cli.options import Boot, CommonOptions, Json, Logs, System
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, wrapped

STYLES = {"ok": "", "warning": "yellow", "fault": "red", "unknown": "dim"}


def command(logs: Logs, common: CommonOptions, json: Json = False, boot: Boot = None, system: System = None) -> None:
    """Say what is in a log and what it can answer.

    Each LOG is checked against physics. What is missing is listed with the setting that would log it.

    Example: attlog info flight.ulg
    """
    from attlog.pipeline.inspection import inspect

    codes: set[int] = set()
    for number, log in enumerate(named_files(logs, codes)):
        with reported(str(log), codes, common.verbose):
            report = inspect(log, boot=boot, system=system)
            if json:
                json_to_stdout(report)
            elif not common.quiet:
                out = console()
                say([""] * (number > 0), out)
                say(lines(printable(report), out.width, common.verbose), out)
    end(codes)


def printable(report: dict[str, Any]) -> dict[str, Any]:
    """Return the report without control characters of the log; strange bytes of a file name as escapes."""
    from attlog.words.text import cleaned, encodable

    name = encodable(report["log"]["name"], "utf-8")
    safe: dict[str, Any] = cleaned(report | {"log": report["log"] | {"name": name}})
    return safe


def lines(report: dict[str, Any], width: int, verbose: int = 0) -> Iterator[TextLine]:
    """Lay out a report of ``inspect`` as text of at most ``width`` columns where words can be broken."""
    from attlog.cli.tables import finding_lines
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
    yield from finding_lines(shown_findings(found), width, bool(verbose))
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
    """Yield file, vehicle, firmware, date and length; the sensors and why they were chosen."""
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
    yield from table(sensors, left=(0, -1), width=width, indent="  ")
    if log["seconds"]:
        yield TextLine(
            "  " + ", ".join(f"{k} {'unknown' if s is None else f'{s:.1f} s'}" for k, s in log["seconds"].items())
        )


def _part(title: str, rows: Sequence[tuple[str, ...]], width: int, styles: list[str]) -> Iterator[TextLine]:
    """Yield a titled table; nothing without rows."""
    if rows:
        yield TextLine("")
        yield TextLine(title, "bold")
        yield from table(rows, left=range(len(rows[0])), width=width, indent="  ", styles=styles)
