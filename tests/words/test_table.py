"""The comparison table: columns, words for what is missing, marks."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from attlog.metrics.metric import CODES, Answer, missing
from attlog.report.figures.style import row_styles
from attlog.result import Result
from attlog.words.names import CODES as WORDS
from attlog.words.table import FilterTable, axis_table, main_table, window_tables
from tests.golden import check_golden
from tests.report.conftest import answer, make_result, unconfirmed_onboard

GOLDEN = Path(__file__).parent / "golden" / "tables.txt"
TILT, NOISE = "tilt_rmse_deg", "noise_tilt_deg"


def printed(title: str, table: FilterTable) -> Iterator[str]:
    """Yield a line for each cell: ``*`` best, ``~`` not ranked, small print, sort key, reason."""
    yield f"== {title}: " + ", ".join(f"{c.title} ({c.unit}, {c.window})" for c in table.columns)
    for row, cells in table.rows:
        yield row.name
        for column, c in zip(table.columns, cells, strict=True):
            marks = "*" * c.best + "~" * c.unranked + "-" * c.missing
            small = f" [{'; '.join(c.small)}]" if c.small else ""
            half = f" {c.half}" if c.half else ""
            sort = "" if c.sort is None else f" sort {c.sort:g}"
            yield f"  {column.metric}: {marks}{c.text}{half}{small} ({c.brief}){sort}" + (
                f": {c.reason}" if c.reason else ""
            )


def changed() -> Result:
    """More phases, another onboard row, a star of the gyro, a row not compared, low coverage, a drift against truth."""
    result = make_result()
    first, baseline, second = result.estimators[:3]
    for row in result.estimators[1:]:
        for phase in ("idle", "hover"):
            row.metrics[phase] = {NOISE: answer(0.3, "deg", phase, 0.1)}
    result.estimators.insert(0, dataclasses.replace(first, name="onboard:AHR2", is_reference=False))
    result.best["rest"][NOISE] = ["gyro", "vqf"]
    result.best["airborne"]["step_gain_roll"] = ["vqf"]
    vqf = next(r for r in result.estimators if r.name == "vqf")
    vqf.metrics["rest"][NOISE] = Answer(0.1, "deg", "rest", ranked=False, reason="does not follow motion")
    result.ranked["rest"][NOISE].remove("vqf")
    baseline.metrics["airborne"][TILT] = answer(2.0, "deg", "airborne")
    baseline.metrics["airborne"][TILT].coverage_pct = 62.0
    second.metrics["airborne"].pop(TILT)
    second.metrics["all"][TILT] = answer(9.0, "deg", "all")
    second.metrics["airborne"]["drift_air_deg_per_min.truth"] = answer(1.0, "deg/min", "airborne")
    for row in result.estimators:
        row.metrics["airborne"]["lag_ms"] = missing("no_events", "no steps", "ms", "airborne")
    return result


def test_tables_are_as_reviewed() -> None:
    plain = make_result()
    lines = [*printed("main", main_table(plain)), *printed("by axis", axis_table(plain))]
    lines += [*printed("main, at rest", main_table(plain, "rest"))]
    for window, table in window_tables(plain).items():
        lines.append(next(printed(f"every metric, {window}", table)))
    check_golden(
        GOLDEN, [*lines, *printed("changed", main_table(changed())), *printed("changed", axis_table(changed()))]
    )
    assert next(iter(row_styles(changed()))) == "onboard"


def test_every_code_has_a_word_and_a_short_one() -> None:
    assert set(WORDS) == set(CODES)
    assert max(len(brief) for _, brief in WORDS.values()) <= 9


def test_the_table_names_agreement_and_no_best_against_an_unproven_onboard_attitude() -> None:
    table = main_table(unconfirmed_onboard())
    assert [c.title for c in table.columns][:2] == ["Agreement with onboard", "Heading against onboard"]
    assert not any(cells[0].best for _, cells in table.rows)
    assert any(cells[0].unranked for _, cells in table.rows)
    known = make_result()
    assert known.reference is not None
    known.reference.choice = "truth"
    assert main_table(known).columns[0].title == "Tilt error RMS"
