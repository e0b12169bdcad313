"""Aids: what is refused, what a segment gets of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.base.errors import UsageError
from attlog.estimators import Aids, Measurements
from attlog.estimators.aids import SIZE

T = np.array([0.0, 1.0, 2.0])
NED = np.ones((3, 3))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Measurements(T, np.ones(2)), "t (n,) and x"),
        (lambda: Measurements(T[:, None], NED), "t (n,) and x"),
        (lambda: Measurements([0.0, 2.0, 1.0], NED), "must be finite and rise"),
        (lambda: Measurements([0.0, 1.0, 1.0], NED), "must be finite and rise"),
        (lambda: Measurements([0.0, 1.0, np.nan], NED), "must be finite and rise"),
        (lambda: Measurements(T, [1.0, np.inf, 1.0]), "values of aids must be finite"),
        (lambda: Measurements(T, [[1.0, np.nan], [np.nan, np.nan], [1.0, 2.0]]), "leave out samples that tell nothing"),
        (lambda: Measurements(T, NED, [1.0, -1.0, 1.0]), "sigma of aids"),
        (lambda: Measurements(T, NED, [1.0, 1.0]), "sigma of aids"),
        (lambda: Measurements(T, ["a", "b", "c"]), "array of numbers"),
        (lambda: Aids(velocity=Measurements(T, NED[:, :2])), "velocity needs x (n, 3)"),
        (lambda: Aids(baro=Measurements(T, NED)), "baro needs x (n,)"),
        (lambda: Aids(position=Measurements(T, NED, [1.0, 1.0, 1.0])), "position needs"),
        (lambda: Aids(mag=Measurements(T, NED[:, :2])), "mag needs x (n, 3)"),
        (lambda: Aids(velocity=(T, NED)), "velocity must be attlog.estimators.Measurements"),
        (lambda: Aids(at_rest=[1.0, 2.0]), "at_rest must be (k, 2)"),
        (lambda: Aids(at_rest=[[3.0, 2.0]]), "must follow each other"),
        (lambda: Aids(at_rest=[[0.0, 2.0], [1.0, 3.0]]), "must follow each other"),
    ],
)
def test_what_is_no_aid_is_refused_in_words(make: Any, words: str) -> None:
    with pytest.raises(UsageError) as refused:
        make()
    assert words in str(refused.value)


def test_estimate_refuses_aids_that_are_none() -> None:
    with pytest.raises(UsageError, match=r"attlog\.estimators\.Aids, not dict"):
        attlog.estimate("gyro", T, NED, aids={})  # type: ignore[arg-type]


def test_the_arrays_are_copies_that_stay_as_they_are() -> None:
    given = T.copy()
    held = Measurements(given, T)
    given[0] = -5.0
    assert held.t[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        held.x[0] = 3.0


def test_a_cut_keeps_what_lies_inside_with_both_ends() -> None:
    aids = Aids(
        velocity=Measurements(T, NED, T),
        baro=Measurements(T + 10, T),
        at_rest=[[0.0, 0.5], [0.8, 1.5], [1.8, 1.9], [3, 4]],
    )
    cut = aids.between(1.0, 2.0)
    assert cut.velocity is not None
    assert cut.velocity.sigma is not None
    assert cut.velocity.t.tolist() == [1.0, 2.0]
    assert cut.velocity.sigma.tolist() == [1.0, 2.0]
    assert cut.baro is None
    assert cut.position is None
    assert cut.at_rest is not None
    assert cut.at_rest.tolist() == [[1.0, 1.5], [1.8, 1.9]]


def test_a_span_that_ends_before_it_begins_holds_nothing() -> None:
    assert Measurements(T, NED).between(1.5, 0.5) is None


def test_rest_is_yes_no_or_unknown() -> None:
    t = np.array([-1.0, 0.0, 0.5, 0.6, 2.0])
    assert Aids(at_rest=[[0.0, 0.5], [1.9, 2.5]]).resting(t).tolist() == [0, 1, 1, 0, 1]
    assert Aids(at_rest=np.empty((0, 2))).resting(t).tolist() == [0] * 5
    assert Aids().resting(t).tolist() == [-1] * 5


WHOLE = '''"""Takes whole segments and shows which aids it got."""
import numpy as np
from attlog.estimators import Estimate
SOURCE = "test"
NEEDS = {"gyro"}
USES = {"gnss", "at_rest"}

def run(t, gyr, acc, mag, aids, params):
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    fixes = 0 if aids.velocity is None else len(aids.velocity.t)
    first = -1.0 if aids.velocity is None else aids.velocity.t[0]
    return Estimate(t=t, q=q, aux={"seen": np.tile([fixes, first, aids.baro is not None], (len(t), 1))})
'''


def test_a_run_gets_of_its_aids_what_lies_in_its_segment(tmp_path: Path) -> None:
    """5 Hz fixes from 0 to 10 s; samples from 0 to 2 and from 5 to 8 s: two segments."""
    file = tmp_path / "whole.py"
    file.write_text(WHOLE)
    t = np.r_[np.arange(0.0, 2.005, 0.01), np.arange(5.0, 8.005, 0.01)]
    fixes = np.arange(0.1, 10.0, 0.2)
    aids = Aids(velocity=Measurements(fixes, np.zeros((len(fixes), 3))), baro=Measurements([0.5], [1.0]))
    seen = attlog.estimate(str(file), t, np.zeros((len(t), 3)), aids=aids).aux["seen"]
    assert seen[0].tolist() == [10.0, 0.1, 1.0]
    assert seen[-1] == pytest.approx([15.0, 5.1, 0.0])
    assert attlog.estimate(str(file), t, np.zeros((len(t), 3))).aux["seen"][0].tolist() == [0.0, -1.0, 0.0]


def test_the_layout_has_a_place_for_everything() -> None:
    from attlog.estimators import aids

    names = "LAT LON ALT POS_H_ACC POS_V_ACC VEL_N VEL_E VEL_D VEL_ACC BARO AIRSPEED AT_REST".split()
    assert [getattr(aids, n) for n in names] == list(range(SIZE))
    assert all(n in (aids.__doc__ or "") for n in names)
