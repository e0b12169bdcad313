"""The file of measured accuracies: what it holds, and that its reader takes it as it stands."""

from __future__ import annotations

import csv

import pytest

from attlog.estimators import names
from attlog.estimators.accuracy import FILE, SETS, measured

HEADING_TOLD = {"gsf": 20}
"""Of the simulated flights those in which GNSS motion tells a heading: no others are trials of such a filter."""


def test_every_filter_of_attlog_was_measured_on_all_trials() -> None:
    trials = {"broad": 15, "euroc": 4, "simulated": 24, "simulated_unbiased": 24}
    assert set(SETS) == set(trials)
    for name in names():
        if name in measured():  # a filter of a package that is installed here was not
            assert {key: one.trials for key, one in measured()[name].items()} == {
                key: HEADING_TOLD.get(name, n) for key, n in trials.items() if key in measured()[name]
            }
    assert {"gyro", "mahony", "mekf", "vqf", "smoother"} <= set(measured())


def test_each_mean_lies_in_its_interval_and_no_part_exceeds_the_whole() -> None:
    for name, sets in measured().items():
        for key, one in sets.items():
            assert ("total" in one.rmse_deg) == (key != "euroc" and name != "package riann"), name
            for rmse in one.rmse_deg.values():
                assert rmse.low is not None
                assert rmse.high is not None
                assert 0.0 < rmse.low < rmse.value < rmse.high
                # the interval is symmetric in the logarithm
                assert rmse.low * rmse.high == pytest.approx(rmse.value**2, rel=5e-3)
            if "total" in one.rmse_deg:
                assert max(one.rmse_deg[a].value for a in ("heading", "inclination")) <= one.rmse_deg["total"].value


def test_the_reader_takes_every_line() -> None:
    with FILE.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(map(len, measured().values()))
    for row in rows:
        one = measured()[row["filter"]][row["set"]]
        assert [one.rmse_deg[a].value for a in one.rmse_deg] == [float(row[a]) for a in one.rmse_deg]
        assert (one.ns, one.version, one.date) == (float(row["ns"]), row["version"], row["date"])


def test_in_short_stand_the_angles_that_the_set_can_tell() -> None:
    assert measured()["gyro"]["broad"].short().count("/") == 2
    assert measured()["gyro"]["euroc"].short().count("/") == 0
    assert float(measured()["gyro"]["broad"].short().split("/")[0]) == pytest.approx(28.8, abs=0.05)
