"""Is the log itself so wrong that its verdicts mean nothing? Then each card says that first."""

from __future__ import annotations

import re

from attlog.present.text import typeset
from attlog.result import Problem, Result, Verdict

NOT_OF_THE_LOG = ("estimator_failed",)
"""Problems of severity error that concern one filter, not the flight."""
FIRST = re.compile(r"[.:;](?= |$)")


def spoiling(result: Result) -> Problem | None:
    """The first severe problem of the log, None where its data can be used."""
    return next((p for p in result.problems if p.severity == "error" and p.code not in NOT_OF_THE_LOG), None)


def spoiled(result: Result, verdict: Verdict) -> Verdict:
    """The verdict, led by what is severely wrong with the log if anything is."""
    problem = spoiling(result)
    if problem is not None:
        text = typeset(problem.text)
        end = FIRST.search(text)
        cause = text[: end.start()] if end else text
        verdict.sentence = f"Do not rely on this: {cause}. {verdict.sentence}"
    return verdict
