"""The file itself: what it embeds, how it is written."""

from __future__ import annotations

import base64
import functools
import gzip
import html
import json
import re
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core.errors import OutputError
from attlog.health.check import agreed_settings
from attlog.health.settings import param_file
from attlog.metrics.statistics import UnitValues
from attlog.metrics.trace import Trace
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.page import file_stem, render, with_fewer_samples
from attlog.result import Finding
from tests.conftest import SAMPLES
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
    assert 'heavily from <a href="#fig-attitude" data-t="12.0" title="Attitude">12.0 s</a>.' in page


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


# Section Sensors: trouble open, the rest folded, what to set with old and new, the file as it is saved.


def section(result) -> str:
    """The section's markup."""
    page = render(result, bundle())
    return page[page.index('<section id="part-sensors"') : page.index('<section id="expert"')]


def opened(markup: str) -> str:
    """What stands in it as opened."""
    while (shorter := re.sub(r"<details>(?:(?!<details>).)*?</details>", "", markup, flags=re.S)) != markup:
        markup = shorter
    return markup


def test_faults_and_warnings_are_open_and_the_rest_is_a_line_each():
    whole = section(make_result())
    seen = opened(whole)
    assert seen.index("compass offset") < seen.index("vibration")
    assert "as set." not in seen
    assert "fly two full turns" not in seen
    assert "gravity at rest, GNSS delay<" in whole
    assert "1 check unknown on this log<" in whole
    assert "GNSS is 203 ms late, as set." in whole


def test_what_to_set_shows_old_and_new():
    text = html.unescape(re.sub(r"<[^>]+>", " ", section(make_result())))
    text = " ".join(text.split())
    assert "COMPASS_OFS_X -12.5 → -133.5" in text
    assert "COMPASS_OFS_Y not logged → 0" in text


def test_the_file_to_save_is_the_one_that_the_writer_made():
    result = make_result()
    markup = section(result)
    text = html.unescape(re.search(r'<pre id="param"[^>]*>(.*?)</pre>', markup, re.S).group(1))
    assert text == param_file(result.log, agreed_settings(result.checks))
    assert 'data-file="flight.param"' in markup


def test_without_anything_to_set_there_is_no_file_and_without_questions_no_table():
    result = make_result()
    for one in result.checks:
        one.settings = []
    assert ".param" not in section(result)
    result.checks = []
    assert "What to set" not in section(result)
    assert "No sensor was found at fault" not in section(result)


def test_sound_sensors_are_one_green_line():
    result = make_result()
    result.checks = [one for one in result.checks if one.verdict == "ok"]
    assert '<p class="fine">No sensor was found at fault.</p>' in section(result)


def test_saved_files_are_named_after_the_log_in_letters_that_every_system_takes():
    result = make_result()
    result.log["name"] = "../a b:<c>\x00.bin"
    assert file_stem(result) == "a_b_c"
    result.log["name"] = "…"
    assert file_stem(result) == "attlog"


def test_a_page_of_a_flight_of_hours_stays_below_3_mb_and_keeps_its_peaks():
    result, n = make_result(), 10_000
    t, noise = np.arange(n) * 3.0, np.random.default_rng(1).normal(size=(40, 3, n))
    noise[:, 0, 7001] = 40.0
    rows = [one.name for one in result.estimators]
    result.traces += [
        Trace("attitude", rows[k % len(rows)], t, dict(zip(("roll", "pitch", "heading"), y, strict=True)))
        for k, y in enumerate(noise)
    ]
    units = UnitValues("mean_square", np.arange(90_000), np.random.default_rng(2).uniform(size=90_000))
    airborne = result.estimators[1].metrics["airborne"]
    airborne["tilt_rmse_deg"] = replace(airborne["tilt_rmse_deg"], units=units)
    text = render(result)
    assert len(text.encode()) <= 3_000_000
    assert "less the evidence of each block" in text
    fewer = with_fewer_samples(result, 0.3)
    assert all(line.columns["roll"].max() == 40.0 for line in fewer.traces[-40:])
    assert "less the evidence" not in render(make_result())


# How many words a page has: 130 on the first screen, 1,100 as it opens. It lists the answers of up to 76 questions.

FIRST, WHOLE = 130, 1100
FIRST_SCREEN = ("happened", "findings", "comparison")
SILENT = ("script", "style", "noscript", "title", "desc")
EMPTY = ("meta", "input", "br", "link", "img", "circle", "line", "rect", "path")


class Words(HTMLParser):
    """Counts words with a letter in what is seen before anything is opened, by section."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[tuple[str, dict[str, str | None]]] = []
        self.count: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in EMPTY:
            self.open.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        while tag not in EMPTY and self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.seen():
            footer = "footer" in [tag for tag, _ in self.open]
            inside = (
                "footer"
                if footer
                else next((a["id"] for t, a in self.open if t == "section" and a.get("id")), "top") or ""
            )
            self.count[inside] = self.count.get(inside, 0) + len(re.findall(r"\S*[A-Za-z]\S*", data))

    def seen(self) -> bool:
        """Whether the innermost text is shown: not in a closed details, not hidden, not for screen readers alone."""
        tags = [tag for tag, _ in self.open]
        if not tags or any(tag in SILENT for tag in tags):
            return False
        if any("hidden" in a or {"vh", "again"} & set((a.get("class") or "").split()) for _, a in self.open):
            return False
        closed = [i for i, (tag, a) in enumerate(self.open) if tag == "details" and "open" not in a]
        return all(i + 1 < len(tags) and tags[i + 1] == "summary" for i in closed)


def counted(page: str) -> tuple[int, int]:
    """Words of the first screen, and of the page as it opens."""
    reader = Words()
    reader.feed(page)
    first = sum(n for section, n in reader.count.items() if section in ("top", *FIRST_SCREEN))
    return first, sum(reader.count.values())


@functools.cache
def page(path: Path) -> str:
    return render(attlog.analyze(path), bundle())


def test_closed_parts_and_labels_for_screen_readers_do_not_count() -> None:
    text = "<main><section id='findings'><p>One two 3</p><details><summary>four</summary><p>five</p></details>"
    text += "<span class='vh'>six</span></section><section id='table'><p>seven</p></section></main>"
    assert counted(text) == (3, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["copter_yaw_turns.bin", "px4_steps.ulg", "px4_hover.ulg", "copter_steps_stabilize.tlog"]
)
def test_a_page_of_a_healthy_flight_is_short(name: str) -> None:
    first, whole = counted(page(SAMPLES / name))
    assert first <= FIRST
    assert whole <= WHOLE


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["px4_1.14_clipping_crash.ulg", "copter_two_compasses.bin", "plane_px4_1.13_crash.ulg"]
)
def test_a_page_of_a_flight_with_trouble_is_short(corpus: Path, name: str) -> None:
    first, whole = counted(page(corpus / "logs" / "cases" / name))
    # findings of 75 words with their links, beside headline, strip and comparison of 120 words
    assert first <= 75 + 120
    assert whole <= WHOLE + 100


def test_where_no_filter_ran_that_is_the_reason_for_missing_figures():
    result = make_result()
    result.estimators = [row for row in result.estimators if row.kind != "replay"]
    result.traces = []
    page = render(result, bundle())
    assert page.count("No figure: no filter ran on this log.") >= 2
    assert "No figure: no part of this log" not in page
    assert re.search(r'id="all" hidden', page)
    assert not re.search(r'id="all" hidden', render(make_result(), bundle()))
