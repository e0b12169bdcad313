"""What became of many logs, in a screen."""

from __future__ import annotations

from pathlib import Path

from attlog.fleet.pages.summary import summary
from attlog.fleet.records.entry import Entry
from tests.fleet.made import failed, flown, reason

OUT = Path("out")


def answering(name: str, *questions: str, reference: str = "truth") -> Entry:
    """A log on which filters answer these questions alone."""
    entry = flown(name, reference=reference)
    assert entry.row is not None
    for verdict in entry.row["verdicts"]:
        verdict["bars"] = [["mahony", 1.0, "deg"]] if verdict["question"] in questions else []
    return entry


def test_it_counts_what_was_answered_and_what_logs_were_compared_with() -> None:
    done = [
        answering("a", "accuracy"),
        answering("b", "accuracy", "noise", reference="smoother"),
        answering("c", reference="onboard"),
        answering("d", "accuracy", reference="smoother"),
        answering("e", reference="none"),
    ]
    assert list(summary(done, 6, 62.0, OUT, again=3)) == [
        "6 logs: 5 reports in out, 62 s; 3 done before; 1 not reached",
        "  compared with: the logged truth 1, the smoother 2, the onboard attitude 1, nothing 1 of 5 logs",
        "  answered: accuracy on 3, noise on 1, lag on 0, yaw drift on 0 of 5 logs",
        "  found: no log with trouble",
    ]


def test_the_gyro_alone_answers_nothing() -> None:
    entry = answering("a")
    assert entry.row is not None
    entry.row["verdicts"][0]["bars"] = [["gyro/imu0", 1.0, "deg"], ["onboard", 0.9, "deg"]]
    assert "  answered: accuracy on 0, noise on 0, lag on 0, yaw drift on 0 of 1 log" in summary([entry], 1, 1.0, OUT)


def test_it_counts_by_reason_and_names_five_logs_to_open_first_with_what_happened() -> None:
    logs = [flown(f"{k}.ulg", reason("sensor", "warning"), headline=f"Rover {k}.") for k in range(4)]
    logs.append(flown("fell.ulg", reason("crash"), headline="Quadrotor: hit the ground."))
    logs.append(flown("bench.ulg", reason("sensor", in_flight=False), airborne_s=0.0, headline="Never flew."))
    logs += [flown("gyro.ulg", reason("sensor"), headline="Plane."), flown("fine.ulg", headline="Nothing.")]
    lines = list(summary(logs, 8, 1.0, OUT, width=400))[3:]
    assert lines[0].removeprefix("  found: ").split("; ") == [
        "a crash or loss of control in 1 log",
        "another serious finding in flight in 1 log",
        "1 more with a serious finding on the ground",
        "4 more to look at",
    ]
    assert lines[1:] == [
        "  open first:",
        "    fell.ulg: Quadrotor: hit the ground.",
        "    gyro.ulg: Plane.",
        "    bench.ulg: Never flew.",
        "    0.ulg: Rover 0.",
        "    1.ulg: Rover 1.",
    ]


def test_gates_that_failed_are_counted_and_open_first() -> None:
    entries = [flown("a", reason("sensor", "warning")), flown("b", gates=("lag_ms 9 ms, at most 5 ms",))]
    lines = list(summary(entries, 2, 1.0, OUT))
    assert "  gates failed on 1 of 2 logs" in lines
    assert lines[-2:] == ["    b: lag_ms 9 ms, at most 5 ms", "    a: Something about the sensor."]


def test_lines_fit_the_terminal_and_no_headline_is_cut() -> None:
    headline = " ".join(f"word{k}" for k in range(30))
    entries = [flown("x" * 60, reason("crash"), headline=headline), failed("y" * 200, "word " * 100)]
    lines = list(summary(entries, 2, 1.0, OUT, width=72))
    assert max(map(len, lines)) <= 72
    assert " ".join(" ".join(lines).split()).endswith(headline)


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
        "  2 logs cannot be used (exit code 65): 0 s of data are too short (such as y0)",
        "  1 log cannot be used (exit code 65): encrypted (x)",
        "  3 logs cannot be used, as before: 000 bytes, no flight log (such as 0.ulg)",
    ]


def test_many_reasons_do_not_fill_the_screen_and_every_log_is_counted() -> None:
    codes = dict.fromkeys("abcdefg", 65) | dict.fromkeys("hi", 70)
    lines = list(summary([Entry(c, c, code, f"{c}: reason {c}") for c, code in codes.items()], 9, 1.0, OUT))
    assert lines[-2:] == [
        "  1 log cannot be used (exit code 65) for other reasons",
        "  2 logs crashed or hit a bug (exit code 70) for other reasons",
    ]
    assert len(lines) == 9


def test_it_counts_the_logs_whose_sensors_are_off_and_those_with_something_to_set() -> None:
    logs = [flown(f"{k}.ulg") for k in range(4)]
    for entry, faults, warnings, settings in zip(
        logs, (2, 0, 1), (0, 1, 3), ([], ["A 1 -> 2", "B 3"], []), strict=False
    ):
        assert entry.row is not None
        entry.row["sensors"] = {"faults": faults, "warnings": warnings, "to_set": settings}
    assert "  sensors: faults in 2 logs, warnings in 2 logs, settings offered for 1 log" in summary(logs, 4, 1.0, OUT)
    assert not [line for line in summary(logs[3:], 1, 1.0, OUT) if "sensors" in line]
