"""The report kept in the repository: small, of the demo's log, without a trace of the machine that made it."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re

from attlog.result import Result
from attlog.result.reading import read
from tests.conftest import ROOT

PAGE = (ROOT / "reports" / "example.html").read_text(encoding="utf-8")
RESULT = json.loads(gzip.decompress(base64.b64decode(re.search(r'id="result">([^<]+)<', PAGE).group(1))))


def test_it_is_the_report_of_the_demo():
    log = re.search(r"attlog analyze (\S+)", (ROOT / "Makefile").read_text(encoding="utf-8")).group(1)
    assert RESULT["log"]["sha256"] == hashlib.sha256((ROOT / log).read_bytes()).hexdigest()
    assert log in RESULT["command"]


def test_it_answers_all_four_questions():
    result = read(Result, json.dumps(RESULT).encode(), "example.html")
    assert [v.question for v in result.verdicts] == ["accuracy", "noise", "lag", "yaw_drift"]
    for verdict in RESULT["verdicts"]:
        assert verdict["bars"]
        assert not verdict["sentence"].startswith(("Cannot", "No filter's"))
        assert len(verdict["sentence"].split()) <= 70


def test_it_is_small_and_names_no_place_on_a_machine():
    assert len(PAGE) < 2_000_000
    assert not re.search(r"/(work|tmp|root|home|Users)/", PAGE + json.dumps(RESULT))


def test_all_sample_logs_together_stay_small():
    assert sum(p.stat().st_size for p in (ROOT / "sample_logs").iterdir()) < 12_000_000
