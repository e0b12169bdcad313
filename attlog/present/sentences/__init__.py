"""The questions in plain sentences, one file each.

Sentences are made by rule from the answers of a Result, never by hand: first the
answer, then the number, then who is worst and by what factor, then the onboard
attitude. What may not be ranked is never named as best, and an interval across
zero reads "no drift told, less than X", never "no drift".
"""

from attlog.present.sentences.drifting import drifting
from attlog.present.sentences.late import late
from attlog.present.sentences.quiet import quiet
from attlog.result import Result, Verdict


def verdicts(result: Result) -> list[Verdict]:
    """The verdicts of a result in the order of the page; always all of them."""
    return [quiet(result), late(result), drifting(result)]


__all__ = ["verdicts"]
