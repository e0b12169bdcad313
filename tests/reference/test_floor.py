"""The step of time stamps, of the attitude's own too."""

from __future__ import annotations

import numpy as np

from attlog.reference.floor import TICK_S, tick_s


def test_stamps_in_whole_milliseconds_that_differ_show_their_step() -> None:
    rng = np.random.default_rng(0)
    assert tick_s(np.cumsum(rng.choice([0.020, 0.021], 200))) == TICK_S
    assert tick_s(np.arange(200) * 0.02) == 0.0, "nothing shows where all are equal"
    assert tick_s(np.cumsum(rng.uniform(0.01, 0.03, 200))) == 0.0


def test_intervals_none_of_which_is_usual_show_no_step() -> None:
    assert tick_s(np.cumsum([0.0, *[0.010, 0.090] * 40])) == 0.0  # the median of an even number lies between them
