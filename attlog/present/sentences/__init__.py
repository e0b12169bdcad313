"""The questions in plain sentences, one file each.

Sentences are made by rule from a Result, never by hand: first the answer, then the
number, then who is worst, then the onboard attitude. Who is best or worst comes from
the ranking that also marks the table (``result.best``, ``result.worst``), so that a
sentence cannot contradict a star. A drift or lag whose interval holds zero is bounded
by the interval's larger end, never called absent.
"""

from attlog.present.sentences.accuracy import accuracy_verdict
from attlog.present.sentences.lag import lag_verdict
from attlog.present.sentences.noise import noise_verdict
from attlog.present.sentences.spoiled import spoiled
from attlog.present.sentences.yaw_drift import yaw_drift_verdict
from attlog.result import Result, Verdict

QUESTIONS = {"accuracy": "accuracy", "noise": "noise", "lag": "lag", "yaw_drift": "yaw drift"}
"""What the questions are called, in the order of the page."""


def verdicts(result: Result) -> list[Verdict]:
    """The verdicts of a result in the order of the page; always all of them."""
    answers = (accuracy_verdict, noise_verdict, lag_verdict, yaw_drift_verdict)
    return [spoiled(result, answer(result)) for answer in answers]


__all__ = ["QUESTIONS", "verdicts"]
