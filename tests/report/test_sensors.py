"""Section Sensors: trouble open, the rest folded, what to set with old and new, the file as it is saved."""

from __future__ import annotations

import html
import re

from attlog.health.assessments import offered
from attlog.health.settings.file import param_file
from attlog.report.bundle import bundle
from attlog.report.page import file_stem, render
from attlog.result import Check
from tests.report.conftest import make_result


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
    assert "Ok: GNSS delay<" in whole
    assert "Unknown on this log: compass soft iron<" in whole
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
    assert text == param_file("ArduPilot", "flight.bin", offered(result.health))
    assert 'data-file="flight.param"' in markup


def test_without_anything_to_set_there_is_no_file_and_without_questions_no_table():
    result = make_result()
    for one in result.health:
        one.settings = []
    assert ".param" not in section(result)
    result.health = []
    assert "What to set" not in section(result)
    assert "No sensor was found at fault" not in section(result)


def test_sound_sensors_are_one_green_line():
    result = make_result()
    result.health = [one for one in result.health if one.verdict == "ok"]
    assert '<p class="fine">No sensor was found at fault.</p>' in section(result)


def test_checks_that_are_not_ok_are_open_and_the_others_folded_below_the_figures():
    result = make_result()
    result.audit = [Check("gaps", "ok", "No gap."), Check("field", "fault", "It bends."), Check("x", "unknown", "?")]
    whole = section(result)
    assert "It bends." in opened(whole)
    assert "No gap." not in opened(whole)
    assert "1 check ok, 1 unknown" in whole
    assert whole.index('id="fig-ratios"') < whole.index("It bends.")


def test_saved_files_are_named_after_the_log_in_letters_that_every_system_takes():
    result = make_result()
    result.log["name"] = "../a b:<c>\x00.bin"
    assert file_stem(result) == "a_b_c"
    result.log["name"] = "…"
    assert file_stem(result) == "attlog"
