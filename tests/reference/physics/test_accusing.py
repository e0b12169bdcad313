"""When an onboard attitude is judged at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog import segments
from attlog.reference import ReferenceOptions, choose
from attlog.reference.physics import accusing

from ..flights import flight


def test_an_onboard_attitude_is_not_judged_before_it_is_aligned(monkeypatch: pytest.MonkeyPatch) -> None:
    log = flight()
    log.truth = replace(log.attitudes["ATT"])
    found = segments.build(log)
    judge = choose(log, found, ReferenceOptions(declination=0.0))
    assert judge.kind == "truth"
    for aligned in (None, judge.scoring_start + 7.0):
        monkeypatch.setattr(accusing.scoring, "aligned_at", lambda *_, at=aligned: at)
        compared = accusing.compared(log, found, judge)
        assert compared is not None
        begin = float(compared.t[np.argmax(compared.counted)])
        assert begin == pytest.approx(judge.scoring_start if aligned is None else aligned, abs=0.1)
