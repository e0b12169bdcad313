"""The questions in plain sentences, one file each.

Sentences are made by rule from a Result, never by hand: first the answer, then the
number, then who is worst, then the onboard attitude. Who is best or worst comes from
the ranking that also marks the table (``result.best``, ``result.worst``), so that a
sentence cannot contradict a star. A drift or lag whose interval holds zero is bounded
by the interval's larger end, never called absent.
"""

from attlog.present.sentences.closest import closest
from attlog.present.sentences.drifting import drifting
from attlog.present.sentences.late import late
from attlog.present.sentences.quiet import quiet
from attlog.present.sentences.spoiled import spoiled
from attlog.result import Result, Verdict

QUESTIONS = {"closest": "accuracy", "quiet": "noise", "late": "lag", "drifting": "yaw drift"}
"""What the questions are called, in the order of the page."""


def verdicts(result: Result) -> list[Verdict]:
    """The verdicts of a result in the order of the page; always all of them."""
    return [spoiled(result, verdict) for verdict in (closest(result), quiet(result), late(result), drifting(result))]


__all__ = ["QUESTIONS", "verdicts"]
