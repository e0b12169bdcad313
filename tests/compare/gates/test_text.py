"""Why a gate has no row to judge."""

from __future__ import annotations

from attlog.compare.gates import text


def test_a_gate_without_filters_names_the_rows_that_there_are():
    assert text.no_filter(["onboard", "onboard:DCM"]) == (
        "the result has no filter to be judged: the rows are onboard, onboard:DCM; name them under filters if they "
        "are meant"
    )
    assert text.no_filter([]) == "the result has no filter to be judged: it has no row"


def test_a_pattern_that_means_nobody_names_who_there_is():
    assert text.no_row("ekf*", ["mahony", "vqf"]) == "no row is called ekf*; the rows are mahony, vqf"
    assert text.no_row("ekf*", []) == "no row is called ekf*; the rows are none"
