"""Who is not ranked in an answer, who is not judged, and why."""

from __future__ import annotations

from collections.abc import Mapping

from attlog.present.numbers import listed
from attlog.present.sentences.yaw_drift import SITUATIONS
from attlog.result import Verdict


def not_ranked(verdict: Verdict) -> set[str]:
    """Rows (by id) that have a value and are not ranked."""
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
