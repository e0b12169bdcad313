"""A paper that nobody wrote: one claim of each verdict, both kinds of figures, a table, a hostile name."""

from __future__ import annotations

import numpy as np

from attlog.reproduce.paper import Claim, FigureLine, Paper, PaperFigure, PaperNumber, PaperSetting, PaperTable, Verdict

T = np.arange(0.0, 10.0, 0.01)
EVIL = "<img src=x onerror=alert(1)>"


def claim(number: int, verdict: Verdict) -> Claim:
    spread = PaperNumber("spread, ours over theirs", 0.8, "ratio", (0.7, 0.9), 20)
    none = PaperNumber("spread of a filter that failed", None, "deg", None, 0)
    return Claim(
        f"c{number}",
        f"Claim {number} of a quiet filter.",
        "fig. 4",
        "The spread at rest over 60 s.",
        (spread, none),
        verdict,
        "20 % quieter: 0.8 deg against 1.0 deg.",
        "0.5 deg" if number == 1 else "",
    )


def paper() -> Paper:
    lines = (
        FigureLine("truth", T, np.sin(T)),
        FigureLine("first filter", T, np.sin(T - 0.1)),
        FigureLine(EVIL, T, np.where(T < 5.0, np.cos(T), np.nan), 1),
    )
    dots = (FigureLine("first filter", [0, 1, 2], [1.0, 2.0, 3.0], 0, [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]),)
    return Paper(
        "made",
        "A paper that nobody wrote",
        "Nobody, 2026",
        (PaperSetting("kp", "0.5", "paper"), PaperSetting("noise", "1", "ours")),
        (claim(1, "holds"), claim(2, "holds in part"), claim(3, "does not hold"), claim(4, "cannot be judged")),
        (
            PaperFigure(
                "tilt", "fig. 4", "Tilt at rest", "Two filters.", "time, s", ("tilt, deg", "heading, deg"), lines
            ),
            PaperFigure(
                "spread", "", "Spread", "By axis.", "", ("spread, deg",), dots, "points", ("roll", "pitch", "yaw")
            ),
        ),
        (PaperTable("Numbers", ("filter", "spread, deg"), (("first filter", "0.8"), (EVIL, "1.0")), "Of 20 seeds."),),
        ("A note.",),
        seeds=20,
        attlog={"version": "0.0"},
        command="attlog reproduce made",
    )
