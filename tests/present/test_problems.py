"""What is wrong in words: cause, remedy and meaning beside it, nothing said twice."""

from __future__ import annotations

from attlog.cli.shared.terminal import wrong
from attlog.present.problems import nothing_wrong, problems
from attlog.result import Problem, Result


def result(*found: Problem) -> Result:
    return Result({}, "", {}, {"name": "x"}, problems=list(found))


def printed(made: Result, verbose: bool = False) -> list[str]:
    return [line.text for line in wrong(problems(made), lambda text: text, 100, verbose)]


GYRO = Problem(
    "gyro_bias", "error", "Standing still the gyro reads -24.30 deg/s.", value=-24.3, unit="deg/s", cause="It is warm.",
    remedy="Calibrate it.", means="Nothing is judged.",
)  # fmt: skip
NOTE = Problem("cut_at_end", "note", "The last record is cut.")


def test_cause_remedy_and_meaning_stand_below_the_sentence() -> None:
    lines = printed(result(GYRO))
    assert lines[0] == "What is wrong with this log"
    assert [line.split()[0] for line in lines[1:]] == ["serious:", "why", "do", "so"]
    assert lines[3].endswith("Calibrate it.")


def test_no_problem_is_only_said_where_there_is_none_and_hidden_notes_are_counted() -> None:
    assert printed(result())[1].strip() == "No problem was found."
    assert printed(result(NOTE))[1].strip() == "No problem was found; 1 note with -v."
    assert "cut" in printed(result(NOTE), verbose=True)[1]
    assert "No problem" not in "".join(printed(result(GYRO, NOTE)))
    assert nothing_wrong(problems(result(NOTE))) == ""


def test_a_time_and_a_remedy_that_the_sentence_holds_are_not_said_again() -> None:
    (one,) = problems(
        result(Problem("x", "warning", "From 54 s on it shakes. Balance it.", t=53.7, remedy="Balance it."))
    )
    assert (one.where, one.more) == ("", ())
    (one,) = problems(result(Problem("x", "warning", "It shakes.", t=53.7, remedy="Balance it.")))
    assert one.where == "at 53.7 s"
    assert one.more == (("do", "Balance it."),)
