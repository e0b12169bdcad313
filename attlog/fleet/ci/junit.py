"""Gates as JUnit XML: a suite per log, a test case per gate and row; valid for Jenkins' junit-10.xsd.

``failure`` is a gate that failed, ``error`` a log that has no result, ``skipped`` an optional gate without an answer.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from attlog import __version__
from attlog.base.files.output import writing
from attlog.compare.gates.outcome import GateOutcome

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold in any form, bytes of a file name that are not UTF-8 among them."""
ANALYSIS = "analysis"
"""The test case that every log has: whether it could be analysed."""


@dataclass(frozen=True, slots=True)
class Suite:
    """The text of a log's suite, packed: ten thousand of them are kept until the end."""

    packed: bytes

    def text(self) -> str:
        """The XML of the suite."""
        return zlib.decompress(self.packed).decode()


def suite(
    log: str, name: str, outcomes: Sequence[GateOutcome], code: int, message: str, seconds: float, known: bool = False
) -> Suite:
    """What the file says of one log; the arguments are those of :func:`attlog.fleet.ci.gating.gated`."""
    time = f' time="{seconds:.3f}"' if seconds > 0.0 else ""
    failures, skipped = (sum(o.status == status for o in outcomes) for status in ("failed", "skipped"))
    skipped += known
    lines = [
        f"<testsuite name={_quoted(log)} tests={_quoted(len(outcomes) + 1)} failures={_quoted(failures)}"
        f" errors={_quoted(int(code != 0 and not known))} skipped={_quoted(skipped)}{time}>",
        f'<properties><property name="report" value={_quoted(name + ".html")}/>'
        f'<property name="attlog" value={_quoted(__version__)}/></properties>',
    ]
    error = "" if code == 0 else _part("error", message, f"exit code {code}", message)
    if known:
        error = f"<skipped message={_quoted(f'as in an earlier run: {message}')}/>"
    lines.append(_case(log, ANALYSIS, error, time))
    in_order = sorted(outcomes, key=lambda o: (o.check, o.row))  # the same place from run to run
    lines += [_case(log, f"{o.row}: {o.check}", _of(o)) for o in in_order]
    return Suite(zlib.compress("\n".join([*lines, "</testsuite>\n"]).encode()))


def write(path: Path, suites: Iterable[Suite | None]) -> None:
    """Write the file of all logs. OutputError if it cannot be written."""
    with writing(path) as file:
        for text in _document(suites):
            file.write(text.encode("utf-8"))


def _document(suites: Iterable[Suite | None]) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="attlog">\n'
    yield from (one.text() for one in suites if one is not None)
    yield "</testsuites>\n"


def _of(outcome: GateOutcome) -> str:
    if outcome.status == "passed":
        return ""
    if outcome.status == "skipped":
        return f"<skipped message={_quoted(outcome.sentence)}/>"
    return _part("failure", outcome.sentence, outcome.cause or "", outcome.sentence)


def _case(log: str, name: str, inside: str, time: str = "") -> str:
    head = f"<testcase classname={_quoted(log)} name={_quoted(name)}{time}"
    return f"{head}>{inside}</testcase>" if inside else f"{head}/>"


def _part(kind: str, message: str, type_: str, text: str) -> str:
    first = message.partition("\n")[0]
    return f"<{kind} message={_quoted(first)} type={_quoted(type_)}>{escape(clean(text))}</{kind}>"


def _quoted(value: object) -> str:
    return quoteattr(clean(str(value)))


def clean(text: str) -> str:
    """The text without what XML cannot hold."""
    return NO_XML.sub("", text)
