"""A verdict on its card, in words: the bold beginning, what the bars are, who is not judged and why."""

from __future__ import annotations

import re
from collections.abc import Mapping

from attlog.present.numbers import MINUS, listed
from attlog.present.sentences.noise import WHERE
from attlog.present.sentences.yaw_drift import SITUATIONS
from attlog.result import Verdict


def caption(verdict: Verdict) -> str:
    """What the bars of a card are."""
    drift = "Drift at rest" if "rest" in verdict.metric else "Drift in the air"
    noise = "Noise" if verdict.window == "rest" else "Noise added to the gyro's"
    return {
        "accuracy": "Tilt error, RMS",
        "noise": f"{noise} of roll and pitch (1σ within 5 s), {WHERE.get(verdict.window, verdict.window)}",
        "lag": f"Lag against the reference; {MINUS}: ahead of it",
        "yaw_drift": drift,
    }.get(verdict.question, "")


def not_ranked(verdict: Verdict) -> set[str]:
    """Rows (by id) whose bar is pale: not ranked."""
    return {name for name, reason in verdict.not_judged if not reason.startswith(SITUATIONS)}


def reasons(verdict: Verdict, names: Mapping[str, str], filters: set[str]) -> list[tuple[str, str]]:
    """Who is not judged, and why: rows with the same reason together, what needs no reason left out.

    ``names`` are the rows' names by id, ``filters`` the ids of all replayed rows.
    """
    gathered: dict[str, list[str]] = {}
    for name, reason in verdict.not_judged:
        if not reason.endswith("itself"):
            gathered.setdefault(reason, []).append(name)
    return [
        ("All filters" if len(who) > 1 and filters <= set(who) else listed([names.get(w, w) for w in who]), reason)
        for reason, who in gathered.items()
    ]


def lead_and_tail(sentence: str) -> tuple[str, str]:
    """The part of a verdict that is set in bold, up to the first full stop or semicolon, and the rest; brackets are
    not cut."""
    nothing = sentence.startswith(("No filter can", "No filter's", "Cannot "))
    end = re.search(rf"[{'.;:' if nothing else '.;'}](?= |$)(?![^(]*\))", sentence)
    return (sentence[: end.end()], sentence[end.end() :].strip()) if end else (sentence, "")
