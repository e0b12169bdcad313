"""What writing figures costs: attlog's packed arrays against plotly's own objects and JSON.

    python benchmarks/figures.py [--runs 15]

Eight figures of ten lines with 4000 points each. Ours: quantised, stored, gzipped and in base64, as the page holds
them; the peer's: ``go.Figure`` and ``to_json``. CPU seconds by turns in one process, medians, imports outside.
"""

from __future__ import annotations

import argparse
from statistics import median

import numpy as np
from measured import Pair, apart, by_turns, cpu
from table import Target, Task, of_pair

FIGURES, LINES, POINTS = 8, 10, 4000


def lines() -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """Times and angles of every line: smooth motion and noise."""
    rng = np.random.default_rng(1)
    t = np.arange(POINTS) / 25.0
    return [
        [(t, 20 * np.sin(0.3 * t + line) + rng.normal(0, 0.2, POINTS)) for line in range(LINES)] for _ in range(FIGURES)
    ]


def compared(runs: int = 15) -> Pair:
    """Both, from arrays to text."""
    import plotly.graph_objects as go

    from attlog.report.bundle import ArrayPacker
    from attlog.report.figures.figure import View, figure_data
    from attlog.report.figures.style import RowStyle

    drawn = lines()
    rows = [RowStyle(str(i), i, "solid") for i in range(LINES)]

    def ours() -> str:
        packer, found = ArrayPacker(), {}
        for i, figure in enumerate(drawn):
            view = View(rows)
            for r, (t, y) in enumerate(figure):
                view.row(r, t, y, unit="deg", meta={"time": True, "step": 0.01})
            found[i] = figure_data(view.as_data(), packer)
        return packer.pack(found)

    def theirs() -> list[str]:
        return [go.Figure([go.Scatter(x=t, y=y) for t, y in figure]).to_json() for figure in drawn]

    ours(), theirs()
    return by_turns(lambda: cpu(ours), lambda: cpu(theirs), runs)


def tasks(runs: int = 15) -> list[Task]:
    """The row about writing figures."""
    what = f"{FIGURES} figures of {LINES} lines, {POINTS} points each, from arrays to text"
    return [Task("Report", what, Target("≥", 5), lambda: of_pair(apart(compared, runs), "plotly", faster=True))]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15)
    pair = compared(parser.parse_args(arguments).runs)
    print(
        f"attlog {1e3 * median(pair.ours):.0f} ms, plotly {1e3 * median(pair.peer):.0f} ms: "
        f"{1 / pair.ratio:.1f} times faster"
    )


if __name__ == "__main__":
    main()
