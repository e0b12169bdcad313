"""Which logs of a batch stand first, and how they are called."""

from __future__ import annotations

import itertools

from attlog.fleet.pages.order import ordered, short_names
from tests.fleet.made import failed, flown, reason

CLASSES = [
    ("crash", [reason("crash")]),
    ("attitude", [reason("attitude")]),
    ("sensor", [reason("sensor")]),
    ("bench", [reason("attitude", in_flight=False)]),
    ("look", [reason("sensor", "warning")]),
    ("fine", []),
]
REAL, STOOD, SIMULATED = {}, {"airborne_s": 0.0}, {"simulated": True}


def test_classes_come_before_points_and_real_flights_before_others_of_their_class() -> None:
    kinds = (("a", REAL), ("b", STOOD), ("c", SIMULATED))
    logs = [flown(f"{name}-{k}.ulg", *why, **about) for name, why in CLASSES for k, about in kinds]
    expected = [entry.name for entry in logs]
    for mixed in (logs[::-1], logs[7:] + logs[:7]):
        assert [log.name for log in ordered(mixed)] == expected


def test_many_sensors_weigh_less_than_one_crash_and_more_than_one_sensor() -> None:
    many = flown("many.ulg", *(reason("sensor") for _ in range(9)))
    logs = [flown("one.ulg", reason("sensor")), many, flown("z.ulg", reason("crash"), simulated=True)]
    assert [log.name for log in ordered(logs)] == ["z.ulg", "many.ulg", "one.ulg"]


def test_a_log_that_failed_stands_between_those_with_trouble_and_those_without() -> None:
    logs = [flown("a.ulg"), failed("b.bin"), flown("c.ulg", reason("sensor", "warning"), simulated=True)]
    assert [log.name for log in ordered(logs)] == ["c.ulg", "b.bin", "a.ulg"]


def test_a_log_of_which_nothing_could_be_re_run_is_not_without_trouble() -> None:
    logs = ordered([flown("a"), flown("b", reference=None), flown("c", reason("sensor"), reference=None), failed("d")])
    assert [(log.name, log.level, log.opens_first) for log in logs] == [
        ("c", "serious", True),
        ("d", "failed", False),
        ("b", "unjudged", False),
        ("a", "none", False),
    ]


def test_what_happened_is_the_headline_else_the_reason_else_the_message() -> None:
    logs = ordered(
        [
            flown("a", reason("crash", text="It fell."), headline="Quadrotor: flew 3 to 9 s."),
            flown("b", reason("crash", text="It fell.")),
            failed("c", "encrypted"),
        ]
    )
    assert [log.text for log in logs] == ["Quadrotor: flew 3 to 9 s.", "It fell.", "encrypted"]


def test_names_lose_the_words_that_all_begin_with_and_no_part_of_a_number() -> None:
    assert short_names(["log_0_12.ulg", "log_0_134.ulg"]) == ["12.ulg", "134.ulg"]
    assert short_names(["2024-05-01 10-20.bin", "2024-05-17 09-00.bin"]) == ["01 10-20.bin", "17 09-00.bin"]
    assert short_names(["flight.bin", "fly.bin"]) == ["flight.bin", "fly.bin"]


def test_a_name_is_never_left_without_a_word() -> None:
    for alone in (["log_1.ulg"], ["log_.ulg", "log_a.b"], ["a.bin", "a.ulg"], []):
        assert short_names(alone) == alone


def test_short_names_of_different_logs_differ() -> None:
    names = [f"{a}{b}" for a, b in itertools.product(("x_1", "x_", "x 2"), ("", "_3", ".ulg"))]
    assert len(set(short_names(names))) == len(names)
