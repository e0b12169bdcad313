"""Write gate results into an existing report.

Gates run after the analysis, and again without one: the page has a placeholder that can be filled repeatedly.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from attlog.core.files import write_atomic
from attlog.core.own_files import REPORT
from attlog.words.numbers import counted
from attlog.words.text import clean

BEGIN, END = "<!--gates-->", "<!--/gates-->"
# Result of a gate: status, check, sentence.
Said = tuple[Literal["passed", "failed", "skipped"], str, str]


def show(report: Path, said: Sequence[Said]) -> bool:
    """Insert gates, worst first, into a report file (atomically).

    False if the page has no placeholder. OutputError if it cannot be written.
    """
    page = report.read_text(encoding="utf-8")
    filled = with_gates(page, said)
    if filled is None:
        return False
    if filled != page:
        write_atomic(report, filled, REPORT)
    return True


def with_gates(page: str, said: Sequence[Said]) -> str | None:
    """Return the page with gate results; None if it has no placeholder."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    return f"{before}{BEGIN}{block(said)}{END}{after}" if begin and end else None


def block(said: Sequence[Said]) -> str:
    """Format gates as HTML; empty without any."""
    if not said:
        return ""
    failed = [sentence for status, _, sentence in said if status == "failed"]
    passed, skipped = (sum(status == kind for status, _, _ in said) for kind in ("passed", "skipped"))
    rest = f", {skipped} skipped" if skipped else ""
    if failed:
        word = f"{len(failed)} of {counted(len(said), 'check')} failed"
        head = f'<p class="alert"><b>Gates: {word}.</b> {_text(failed[0])}</p>'
    else:
        head, word = "", f"{counted(passed, 'check')} passed"
    mark, verdict = ("bad", "failed") if failed else ("good", "passed") if passed else ("", "skipped")
    title = f'<span class="chk {mark}">{verdict}</span> Gates: {word}{rest}'
    rows = "".join(
        f'<tr class="{status}"><td>{status}</td><td>{_text(check)}</td><td>{_text(sentence)}</td></tr>'
        for status, check, sentence in said
    )
    head_row = '<tr><th scope="col">Result</th><th scope="col">Check</th><th scope="col">What was found</th></tr>'
    return (
        f'{head}<details class="gates"><summary>{title}</summary><div class="scroll" tabindex="0" role="region" '
        f'aria-label="Gates"><table class="kv"><thead>{head_row}</thead><tbody>{rows}</tbody></table></div></details>'
    )


def _text(text: str) -> str:
    return html.escape(clean(text))
