"""Signs of one kind that are too many to list: one with their number, the first of them and what all share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from attlog.health.findings.finding import Finding

MANY = 5
"""Up to so many signs of one kind stand for themselves; a hostile or badly damaged log brings hundreds."""
SHOWN = 3
"""Of more than that, so many are quoted."""


def joined(signs: Iterable[Finding]) -> list[Finding]:
    """The signs in their order; equal ones once, more than :data:`MANY` of a kind and severity as one sign.

    Its ``count`` is the sum of theirs. Cause and action stay where all have the same.
    """
    kinds: dict[tuple[str, str, str], list[Finding]] = {}
    for sign in signs:
        kinds.setdefault((sign.kind, sign.severity, sign.about), []).append(sign)
    told: list[Finding] = []
    for same in kinds.values():
        told += same if len(same) <= MANY else [_one(same)]
    return told


def _one(same: list[Finding]) -> Finding:
    first, *_ = same
    times = [sign.t for sign in same if sign.t is not None]
    return replace(
        first,
        text=f"{first.text.rstrip('.')}, and {len(same) - 1} more of the kind.",
        t=min(times, default=None),
        count=sum(sign.count for sign in same),
        value=None,
        unit="",
        evidence=[sign.text for sign in same[1:SHOWN]],
        cause=_shared([sign.cause for sign in same]),
        action=_shared([sign.action for sign in same]),
    )


def _shared(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else ""
