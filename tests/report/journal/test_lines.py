"""Long lines keep their peaks and gaps; ranges leave out what diverged."""

from __future__ import annotations

import numpy as np

from attlog.report.journal.canvas import Canvas, RowLine
from attlog.report.journal.lines import BUCKETS, fitted, leaving, thinned

MARKS = {name: [] for name in ("airborne", "rest", "impact", "gaps", "resets", "texts")}


def canvas(*lost: bool) -> Canvas:
    rows = [RowLine(f"row {i}", "#111111", "solid", 1.0, gone, False) for i, gone in enumerate(lost)]
    return Canvas(rows, set(range(len(rows))), MARKS, (0.0, 10.0))


def test_peaks_gaps_and_order_of_a_long_line_stay() -> None:
    t = 0.01 * np.arange(100_000)
    y = np.sin(t)
    y[77_777], y[12_345], y[5_000:5_400] = 9.0, -9.0, np.nan
    x, kept = thinned(t, y)
    assert len(x) <= 3 * BUCKETS
    assert (np.nanmax(kept), np.nanmin(kept)) == (9.0, -9.0)
    assert np.isnan(kept[(x >= 50.0) & (x < 54.0)]).any()
    assert (np.diff(x) > 0).all()
    assert np.array_equal(kept, np.interp(x, t, y), equal_nan=True)


def test_a_short_line_stays_whole_and_a_span_cuts_it() -> None:
    t = np.arange(100.0)
    assert np.array_equal(thinned(t, t)[0], t)
    assert thinned(t, t, (10.0, 20.0))[0].tolist() == list(range(9, 22))


def test_a_full_turn_breaks_the_line() -> None:
    _, y = thinned(np.arange(4.0), np.array([170.0, 179.0, -179.0, -170.0]), wraps=True)
    assert np.isnan(y).tolist() == [False, False, True, False, False]


def test_a_diverged_row_does_not_set_the_range_and_leaves_with_an_arrow() -> None:
    figure, t = canvas(False, True), np.arange(10.0)
    figure.row(0, t, np.ones(10), yaxis="y")
    figure.row(1, t, 100.0 * t, yaxis="y")
    low, high = fitted(figure, figure.traces, 2.0)
    assert (low, high) == (0.0, 2.0)
    figure.axes = {"xaxis": {"range": [0.0, 10.0]}, "yaxis": {"range": [low, high]}}
    leaving(figure)
    assert [t["marker"]["symbol"] for t in figure.traces if t["mode"] == "markers"] == ["triangle-up"]
    assert [t.get("opacity", 1.0) for t in figure.traces if t["mode"] == "lines"] == [1.0, 0.35]


def test_a_calm_figure_leaves_out_who_moves_far_more() -> None:
    figure, t = canvas(False, False, False), np.arange(10.0)
    for r, size in enumerate((1.0, 1.1, 50.0)):
        figure.row(r, t, size * (t % 2))
    assert fitted(figure, figure.traces, 0.1, calm=True)[1] < 2.0
    assert fitted(figure, figure.traces, 0.1)[1] > 40.0
