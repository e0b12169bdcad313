"""JUnit files: valid for Jenkins, read by another program, whatever the names of logs hold."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import xmlschema
from junitparser import Error, Failure, JUnitXml, Skipped

from attlog.base.errors import OutputError
from attlog.fleet.ci import junit
from attlog.fleet.ci.gating import gated
from tests.fleet.gated import NASTY, outcome, some

OURS = Path(__file__).with_name("junit.xsd")
SCHEMAS = [OURS, *(Path(p) for p in [os.environ.get("ATTLOG_JUNIT_XSD", "")] if p)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    junit.write(tmp_path / "junit.xml", (j.suite for j in some()))
    return tmp_path / "junit.xml"


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda path: path.name)
def test_the_file_is_valid(file: Path, schema: Path) -> None:
    xmlschema.validate(file, schema)
    assert not xmlschema.is_valid(file.read_text("utf-8").replace("<testcase ", "<test ", 1), schema)


def test_another_program_reads_what_was_judged(file: Path) -> None:
    suites = {suite.name: suite for suite in JUnitXml.fromfile(str(file))}
    good, bad, gone = suites["good.ulg"], suites["bad.ulg"], suites["gone.ulg"]
    assert [(s.tests, s.failures, s.errors, s.skipped) for s in (good, bad, gone)] == [
        (3, 0, 0, 1),
        (4, 2, 0, 0),
        (1, 0, 1, 0),
    ]
    assert good.time == pytest.approx(12.346)
    told = {case.name: case.result for case in bad}
    (failure,) = told["c: lag_ms@airborne max=5"]
    assert isinstance(failure, Failure)
    assert (failure.type, failure.message) == ("limit", "c: lag_ms 45 ms (airborne), at most 5 ms")
    assert told["analysis"] == told["b: lag_ms@airborne max=5"] == []
    assert {case.classname for case in bad} == {"bad.ulg"}
    (skipped,) = next(case.result for case in good if case.name.startswith("b:"))
    assert isinstance(skipped, Skipped)
    (error,) = next(case.result for case in gone)
    assert isinstance(error, Error)
    assert (error.type, error.message) == ("exit code 66", "gone.ulg: cannot be read")
    assert "(no such file)" in error.text


def test_nothing_in_a_name_breaks_the_file(file: Path) -> None:
    expected = NASTY.translate({0: None, 0x1B: None, 0xD800: None, 0xFFFE: None})
    (nasty,) = [suite for suite in JUnitXml.fromfile(str(file)) if "<i>" in suite.name]
    assert nasty.name == expected
    assert next(case.result for case in nasty if case.result)[0].text == f"{expected}: worse\nthan that"


def test_checks_keep_their_place_when_outcomes_come_in_another_order() -> None:
    found = [outcome("b", excess=3.0), outcome("a", excess=2.0), outcome("a", "passed", check="status")]
    texts = {s.text() for s in (gated("x", "x", o).suite for o in (found, found[::-1])) if s is not None}
    assert len(texts) == 1


def test_ten_thousand_logs_take_little_memory() -> None:
    many = gated("x.ulg", "x.ulg", [outcome(f"filter{k}", "passed", 0.5) for k in range(60)])
    assert many.suite is not None
    assert len(many.suite.packed) < 2000


def test_a_place_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        junit.write(tmp_path / "file" / "junit.xml", [])
