"""The page of a batch: what stands in it, in which order, and that strange names are only names."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import pytest

from attlog.batch.index_page import INDEX, first_row, page_data, render, write_index
from attlog.batch.order import index_rows
from attlog.core.errors import OutputError
from tests.batch.made import failed, flown, many, reason

EVIL = "</script><script>document.title='ran'</script><img src=x onerror=alert(1)>'\"\x00\u202e{{7*7}}"


def inside(html: str) -> tuple[dict[str, Any], bytes]:
    """What the page's script unpacks."""
    found = re.search(r'id="data">([^<]*)</script>', html)
    assert found is not None
    raw = gzip.decompress(base64.b64decode(found[1]))
    size = int.from_bytes(raw[:4], "little")
    return json.loads(raw[4 : 4 + size]), raw[4 + size :]


@pytest.mark.parametrize("name", ["a \"b\" 'c'.ulg", "50%#1?.bin", "Flüge 飛行.ulg", "a&b=c;d.tlog", "x\udcff.ulg"])
def test_links_lead_to_the_file_of_any_name(name: str) -> None:
    data, _ = inside(render([flown(name)]))
    href = data["href"][0]
    assert re.fullmatch(r"[\w.%~-]+", href)
    assert unquote_to_bytes(href) == os.fsencode(f"{name}.html")


def test_equal_logs_give_an_equal_page_in_any_order() -> None:
    entries = many(60)
    assert render(entries, title="x") == render(entries[::-1], title="x")


def test_numbers_stand_at_their_log() -> None:
    entries = [flown("b.ulg", scale=2.0), failed("c.ulg"), flown("a.ulg", reason("crash"), scale=3.0)]
    data, thumbs = inside(render(entries))
    assert data["name"] == ["a.ulg", "c.ulg", "b.ulg"]
    tilt = next(c for c in data["columns"] if c["metric"] == "tilt_rmse_deg")
    three, none, two = tilt["values"]["vqf"]
    assert (three / two, none) == (pytest.approx(1.5, rel=1e-3), None)
    assert not [c for c in data["columns"] if c["metric"] == "cost_ns"]
    assert len(thumbs) == 2 * data["points"]
    assert data["first"] in data["rows"]


def test_no_text_becomes_markup() -> None:
    plain = render([flown("a.ulg"), failed("b.ulg")], title="t")
    entries = [
        flown(
            EVIL.replace("/", "_"), reason("crash", text=EVIL), vehicle=EVIL, firmware=EVIL, date_utc=EVIL, board=EVIL
        ),
        failed(EVIL, EVIL),
    ]
    html = render(entries, title=EVIL)
    assert html.count("<script") == plain.count("<script")
    assert "<img" not in html
    assert "\x00" not in html
    assert "\u202e" not in html
    data, _ = inside(html)
    assert "\u202e" not in json.dumps(data, ensure_ascii=False)


def test_the_page_loads_nothing_and_allows_its_own_script_only() -> None:
    html = render(many(20))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    assert policy[1].startswith("default-src &#39;none&#39;; script-src &#39;sha256-")
    assert "unsafe" not in policy[1]
    markup = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", html, flags=re.S)
    assert not re.search(r" style=|<[^>]*\son[a-z]+=|src=|https?:", markup)


def test_without_javascript_the_worst_are_listed_with_links_and_reasons() -> None:
    html = render([flown("a b.ulg", reason("crash", text="It fell.")), failed("c.ulg"), flown("fine.ulg")])
    without = html.partition("<noscript>")[2].partition("</noscript>")[0]
    assert '<a href="a%20b.ulg.html">a b.ulg</a>: It fell.' in without
    assert "<b>c.ulg</b>: not a flight log" in without
    assert "fine.ulg" not in without


def test_an_old_page_survives_a_failure(tmp_path: Path) -> None:
    path = write_index(tmp_path, [flown("a.ulg")])
    assert path == tmp_path / INDEX
    assert f"Attitude of many flights <span>{tmp_path.name}</span>" in path.read_text(encoding="utf-8")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        write_index(tmp_path / "file", [])


def test_numbers_of_the_onboard_attitude_are_shown_first_else_those_of_the_filter_with_most() -> None:
    def column(**values: list[float | None]) -> dict[str, Any]:
        return {"values": values}

    filters = column(gyro=[0.1] * 3, mahony=[2.0, None, None], vqf=[1.0, 9.0, None], **{"onboard:AHR2": [0.1] * 3})
    rows = ("onboard", "gyro", "mahony", "vqf", "onboard:AHR2")
    assert first_row(rows, [filters]) == "vqf"
    assert first_row(rows, [filters, column(onboard=[None, 1.0, None])]) == "onboard"
    assert first_row(["gyro"], [column(gyro=[1.0])]) == "gyro"
    assert first_row([], []) == ""


@pytest.mark.parametrize(("reference", "judged"), [("truth", True), ("smoother", True), ("onboard", False)])
def test_onboard_errors_stand_only_where_a_reference_may_judge_them(reference: str, judged: bool) -> None:
    entry = flown("a.ulg", reference=reference)
    for column in entry.row["columns"]:
        column["values"] |= {"onboard": 1.0, "onboard:AHR2": 2.0}
    columns = page_data(index_rows([entry]))[0]["columns"]
    errors = [c for c in columns if c["metric"] in ("tilt_rmse_deg", "lag_ms")]
    others = [c for c in columns if c["metric"].startswith("noise_")]
    assert errors
    assert others
    assert all(("onboard" in c["values"]) == ("onboard:AHR2" in c["values"]) == judged for c in errors)
    assert all("vqf" in c["values"] for c in errors)
    assert all("onboard" in c["values"] for c in others)


def test_the_page_holds_what_is_off_with_the_sensors_and_what_to_set_without_signs_that_steer() -> None:
    entry = flown("a.ulg")
    entry.row["sensors"] = {"faults": 1, "warnings": 2, "to_set": ["A\x1b[31m 1 -> 2"]}
    data, _ = inside(render([entry, failed("b.bin")]))
    sensors = dict(zip(data["name"], data["sensors"], strict=True))
    assert sensors["a.ulg"][:2] == [1, 2]
    assert sensors["b.bin"] == [0, 0, []]
    assert "\x1b" not in sensors["a.ulg"][2][0]


def test_agreement_with_onboard_is_a_column_apart_from_errors() -> None:
    sound, against = flown("a.ulg"), flown("b.ulg", reference="onboard")
    for column in against.row["columns"]:
        if column["metric"] == "tilt_rmse_deg":
            column |= {"title": "Agreement with onboard", "agreement": True}
    columns = page_data(index_rows([sound, against]))[0]["columns"]
    tilt = {c["title"]: c for c in columns if c["metric"] == "tilt_rmse_deg"}
    assert [c["agreement"] for c in tilt.values()] == [False, True]
    assert all(sum(x is not None for x in c["values"]["vqf"]) == 1 for c in tilt.values())
