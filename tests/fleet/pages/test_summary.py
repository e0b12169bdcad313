"""What became of many logs, in a few lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog.fleet.pages.summary import summary
from attlog.fleet.records.entry import Entry

OUT = Path("out")


def row(answered: tuple[str, ...] = (), **points: float) -> dict[str, Any]:
    """A row with answers to these questions and reasons of these weights."""
    reasons = [
        {"kind": "sensor", "code": code, "points": weight, "text": f"{code} is wrong.", "t": None}
        for code, weight in points.items()
    ]
    level = "serious" if any(p >= 40 for p in points.values()) else "look" if points else "none"
    return {
        "verdicts": [
            {"question": q, "bars": [["mahony", 1.0, "deg"]] if q in answered else []}
            for q in ("closest", "quiet", "late", "drifting")
        ],
        "trouble": {"level": level, "score": sum(points.values()), "reasons": reasons},
    }


def test_it_tells_what_was_answered_what_failed_and_the_worst_five_in_order() -> None:
    done = [Entry(f"{k}.bin", f"{k}.bin", row=row(("closest",), field=10.0 + k)) for k in range(7)]
    quiet = Entry("q.bin", "q.bin", row=row(("closest", "quiet")))
    broken = [Entry(f"{k}.ulg", f"{k}.ulg", 65, f"{k}.ulg: no log") for k in range(2)] + [
        Entry("t", "t", 75, "t: slow")
    ]
    lines = list(summary([*done, quiet, *broken], 12, 62.0, OUT, again=3))
    assert lines == [
        "12 logs: 8 reports in out, 62 s; 3 done before; 1 not reached",
        "  answered: closest on 8, quiet on 1, late on 0, drifting on 0 of 8 logs",
        "  2 logs cannot be used (exit code 65): 0.ulg: no log (and 1 more)",
        "  1 log took more time or memory than allowed (exit code 75): t: slow",
        "  0 logs with serious trouble, 7 to look at; the worst:",
        *(f"    {k}.bin: field is wrong." for k in (6, 5, 4, 3, 2)),
    ]


def test_a_gate_that_failed_comes_before_all_other_trouble() -> None:
    entries = [Entry("a", "a", row=row(gyro=40.0)), Entry("b", "b", row=row(), gates=("lag_ms 9 ms, at most 5 ms",))]
    lines = list(summary(entries, 2, 1.0, OUT))
    assert "  gates failed on 1 of 2 logs" in lines
    assert lines[-2:] == ["    b: lag_ms 9 ms, at most 5 ms", "    a: gyro is wrong."]


def test_the_gyro_alone_answers_nothing() -> None:
    flight = row()
    flight["verdicts"][0]["bars"] = [["gyro/imu0", 1.0, "deg"], ["onboard", 0.9, "deg"]]
    lines = list(summary([Entry("a", "a", row=flight)], 1, 1.0, OUT))
    assert lines[1] == "  answered: closest on 0, quiet on 0, late on 0, drifting on 0 of 1 log"


def test_without_trouble_it_counts_none_and_units_are_written_as_in_reports() -> None:
    flight = row(jump=7.0)
    flight["trouble"]["level"] = "none"
    flight["trouble"]["reasons"][0]["text"] = "The heading is realigned by 4.7 deg."
    assert list(summary([Entry("a", "a", row=flight)], 1, 1.0, OUT))[-2:] == [
        "  no log with trouble; what was noticed most:",
        "    a: The heading is realigned by 4.7°.",
    ]


def test_lines_fit_the_terminal() -> None:
    entries = [Entry("x" * 70, "x" * 70, row=row(gyro=40.0)), Entry("y", "y", 65, "word " * 100)]
    assert max(map(len, summary(entries, 2, 1.0, OUT, width=72))) <= 72


def test_nothing_done_is_told_without_a_table() -> None:
    assert list(summary([], 3, 0.0, OUT)) == ["3 logs: 0 reports in out, 0.0 s; 3 not reached"]


def test_failures_are_grouped_by_reason_and_those_of_an_earlier_run_come_last() -> None:
    old = [Entry(f"{k}.ulg", f"{k}.ulg", 65, f"{k}.ulg: {k}00 bytes, no flight log", known=True) for k in range(3)]
    new = [
        Entry("x", "x", 65, "x: encrypted"),
        *(Entry(f"y{k}", f"y{k}", 65, f"y{k}: {k} s of data are too short") for k in range(2)),
    ]
    assert list(summary([*old, *new], 6, 1.0, OUT)) == [
        "6 logs: 0 reports in out, 1.0 s; 3 failed before",
        "  2 logs cannot be used (exit code 65): y0: 0 s of data are too short (and 1 more)",
        "  1 log cannot be used (exit code 65): x: encrypted",
        "  3 logs cannot be used, as before: 0.ulg: 000 bytes, no flight log (and 2 more)",
    ]


def test_many_reasons_do_not_fill_the_screen() -> None:
    lines = list(summary([Entry(c, c, 65, f"{c}: reason {c}") for c in "abcdefghi"], 9, 1.0, OUT))
    assert lines[-1] == "  3 logs failed for 3 other reasons"
    assert len(lines) <= 8
