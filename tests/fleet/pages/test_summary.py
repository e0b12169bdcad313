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
        "  compared with: truth 1, smoother 2, onboard 1, nothing 1",
        "  answered: accuracy 3, noise 1, lag 0, yaw drift 0",
        "  found: without trouble 5",
    ]


def test_the_gyro_alone_answers_nothing() -> None:
    entry = answering("a")
    assert entry.row is not None
    entry.row["verdicts"][0]["bars"] = [["gyro/imu0", 1.0, "deg"], ["onboard", 0.9, "deg"]]
    assert "  answered: accuracy 0, noise 0, lag 0, yaw drift 0" in summary([entry], 1, 1.0, OUT)


def test_it_counts_by_reason_and_names_five_logs_to_open_first_with_what_happened() -> None:
    logs = [flown(f"{k}.ulg", reason("sensor", "warning"), headline=f"Rover {k}.") for k in range(4)]
    logs.append(flown("fell.ulg", reason("crash"), headline="Quadrotor: hit the ground."))
    logs.append(flown("bench.ulg", reason("sensor", in_flight=False), airborne_s=0.0, headline="Never flew."))
    logs += [flown("gyro.ulg", reason("sensor"), headline="Plane."), flown("fine.ulg", headline="Nothing.")]
    lines = list(summary(logs, 8, 1.0, OUT, width=400))[3:]
    assert lines[0].removeprefix("  found: ").split(", ") == [
        "crash or loss of control 1",
        "other serious finding in flight 1",
        "serious on the ground 1",
        "to look at 4",
        "without trouble 1",
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
        "  3 logs cannot be used (exit code 65):",
        "    0 s of data are too short (y0 and 1 more)",
        "    encrypted (x)",
        "  3 logs cannot be used, as before:",
        "    000 bytes, no flight log (0.ulg and 2 more)",
    ]


def test_many_reasons_do_not_fill_the_screen_and_every_log_is_counted() -> None:
    codes = dict.fromkeys("abcdefg", 65) | dict.fromkeys("hi", 70)
    lines = list(summary([Entry(c, c, code, f"{c}: reason {c}") for c, code in codes.items()], 9, 1.0, OUT))
    assert lines[1] == "  7 logs cannot be used (exit code 65), such as:"
    assert lines[-1] == "  2 logs crashed or hit a bug (exit code 70)"
    assert len(lines) == 8


def test_a_hundred_logs_take_twenty_five_lines() -> None:
    kinds = [reason("crash"), reason("attitude"), reason("sensor"), reason("sensor", "warning")]
    headline = (
        "Quadrotor, PX4 1.14.3: flew 34 to 46 s. Accelerometer clipped from 37 s. Hit the ground at 46.1 s (13 g)."
    )
    logs = [flown(f"{k}.ulg", kinds[k % 4], headline=headline) for k in range(80)]
    logs += [failed(f"{k}.bin", f"why {'x' * (k % 9)} not " * 9, (65, 66, 70)[k % 3]) for k in range(20)]
    assert len(list(summary(logs, 100, 60.0, OUT, width=100))) <= 25


def test_it_counts_the_logs_whose_sensors_are_off_and_those_with_something_to_set() -> None:
    logs = [flown(f"{k}.ulg") for k in range(4)]
    for entry, faults, warnings, settings in zip(
        logs, (2, 0, 1), (0, 1, 3), ([], ["A 1 -> 2", "B 3"], []), strict=False
    ):
        assert entry.row is not None
        entry.row["sensors"] = {"faults": faults, "warnings": warnings, "to_set": settings}
    assert "  sensors: faults in 2 logs, warnings in 2 logs, settings offered for 1 log" in summary(logs, 4, 1.0, OUT)
    assert not [line for line in summary(logs[3:], 1, 1.0, OUT) if "sensors" in line]
