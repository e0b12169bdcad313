"""The stages of an analysis: said when they begin, timed, and followed by giving their memory back."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from attlog.base.memory import give_back

STAGES = logging.getLogger("attlog.stages")
"""Tells what is being done; who wants to know adds a handler."""
SENTENCES = {
    "read": "reading the log",
    "segments": "finding rest and flight",
    "reference": "aligning the reference",
    "smoother": "smoothing the whole flight",
    "estimators": "running filters",
    "metrics": "measuring",
    "audit": "checking against physics",
    "sensors": "assessing the sensors",
}


class Stages:
    """Seconds of wall time by stage, added to those of earlier ones; a stage within another counts for itself.

    ``samples``: how many inertial samples the log has, once it was read: what a stage freed goes back to the system
    where they are many.
    """

    def __init__(self, earlier: Mapping[str, float] | None = None, samples: int = 0) -> None:
        self.seconds: dict[str, float] = dict(earlier or {})
        self.samples = samples
        self._within = 0.0

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin, before, self._within = time.perf_counter(), self._within, 0.0
        STAGES.info(SENTENCES[stage])
        try:
            yield
        finally:
            give_back(self.samples)
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent - self._within
            self._within = before + spent
