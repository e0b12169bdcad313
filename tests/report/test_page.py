"""The file itself: what it embeds, how it is written."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
import tomllib

import pytest

from attlog.base.errors import OutputError
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.page import render
from attlog.result import Finding
from tests.report.conftest import make_result


def test_the_page_holds_the_same_json_as_the_result():
    result = make_result()
    block = re.search(r'id="result">([^<]+)<', render(result, bundle())).group(1)
    assert json.loads(gzip.decompress(base64.b64decode(block))) == json.loads(result.to_json())


def test_the_same_result_gives_the_same_page():
    result = make_result()
    assert render(result, bundle()) == render(result, bundle())


def test_without_measured_times_two_runs_give_the_same_bytes(tmp_path):
    pages = []
    for factor in (1.0, 2.0):
        result = make_result()
        result.timing = {stage: factor * seconds for stage, seconds in result.timing.items()}
        for row in result.estimators:
            row.ns_per_update = None if row.ns_per_update is None else factor * row.ns_per_update
            if "all" in row.metrics:
                row.metrics["all"]["cost_ns"].value *= factor
        write_report(result, tmp_path / "report.html", deterministic=True)
        pages.append((tmp_path / "report.html").read_bytes())
    assert pages[0] == pages[1]
    assert b"Time taken" not in pages[0]
    block = re.search(r'id="result">([^<]+)<', pages[0].decode()).group(1)
    assert json.loads(gzip.decompress(base64.b64decode(block))) == make_result().to_dict(deterministic=True)


def test_the_configuration_can_be_copied_into_a_file():
    text = re.search(r'<pre id="config"[^>]*>(.*?)</pre>', render(make_result(), bundle()), re.S).group(1)
    config = tomllib.loads(html.unescape(text))
    assert config["reference"] == "auto"
    assert "imu" not in config


def test_a_place_that_cannot_be_written_is_an_output_error_and_leaves_the_old_report(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(make_result(), tmp_path / "file" / "report.html")
    assert (tmp_path / "file").read_text() == "not a folder"


def test_every_definition_parameter_segment_and_alignment_step_is_in_the_page():
    result = make_result()
    text = html.unescape(render(result, bundle()))
    for definition in result.definitions.values():
        assert definition["text"] in text
    for segment in result.segments:
        assert segment.why in text
    for step in result.reference.alignment:
        assert step.text in text
    for value in (result.log["sha256"], result.command, "2a3dc4b7", "gain of the correction", "AHRS_TRIM_X"):
        assert value in text


def test_what_to_fix_stands_above_the_comparison_with_its_action_and_why():
    result = make_result()
    result.findings.append(
        Finding("x", "serious", "It shakes heavily from 12.0 s.", t=12.0, cause="A loose arm.", action="Fasten it.")
    )
    page = render(result, bundle())
    places = [page.index(mark) for mark in ('id="findings"', "It shakes heavily", 'id="comparison"', 'id="table"')]
    assert places == sorted(places)
    assert all(text in page for text in ("Cause: A loose arm.", "<b>Fasten it.</b>"))
    assert 'heavily from <a href="#part-flight" data-t="12.0">12.0 s</a>.' in page


def test_no_sentence_of_the_page_ends_twice():
    """The words of a figure get their full stop from the page."""
    text = re.sub(r"<(script|style|pre)\b.*?</\1>|<[^>]+>", " ", render(make_result(), bundle()), flags=re.S)
    assert re.findall(r".{40}\w\.\.(?!\.)", text) == []
    assert "Heading minus course" in text


@pytest.mark.parametrize(("imus", "said"), [(2, "0 s is the first IMU sample"), (0, "0 s is the first record used")])
def test_the_clock_begins_with_what_the_log_holds(imus: int, said: str):
    result = make_result()
    result.log["imus"] = imus
    assert said in render(result, bundle())
