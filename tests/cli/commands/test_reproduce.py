"""``attlog reproduce``: pages, JSON, the claims on the terminal, and what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from attlog.cli.commands.reproduce import printed
from attlog.reproduce.lyu import claims as lyu
from attlog.reproduce.paper import Paper, PaperOptions
from attlog.reproduce.seeds import each_seed
from tests.conftest import SAMPLES
from tests.reproduce.made import paper


@pytest.mark.parametrize("made", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_paper_is_told_on_the_terminal_and_written_as_page_and_json(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: bool
) -> None:
    if made:
        monkeypatch.setattr(lyu, "paper", lambda options: replace(paper(), key="lyu", seeds=options.seeds))
    done = attlog("reproduce", "lyu", "--seeds", "2", "-j", "1", "-o", tmp_path)
    assert done.code == 0, done.err
    assert "does not hold" in done.out
    assert {p.name for p in tmp_path.iterdir()} == {"reproduce-lyu.html", "reproduce-lyu.json"}
    told = json.loads((tmp_path / "reproduce-lyu.json").read_text(encoding="utf-8"))
    assert (told["key"], told["seeds"]) == ("lyu", 2)
    verdicts = {c["verdict"] for c in told["claims"]}
    assert verdicts <= {"holds", "holds in part", "does not hold", "cannot be judged"}
    for claim in told["claims"]:
        assert claim["verdict"] in done.out
    assert done.out.splitlines()[-1] == f"page: {tmp_path / 'reproduce-lyu.html'}"


@pytest.mark.parametrize("width", [70, 80, 200])
def test_claims_are_a_table_that_fits_the_terminal(width: int) -> None:
    lines = [line.text for line in printed(paper(), Path("a.html"), width=width)]
    assert max(map(len, lines)) <= width
    rows = [line for line in lines if re.match(r"\d\. Claim", line)]
    assert [row.split("  ")[-1].strip() for row in rows] == [
        "holds",
        "holds in part",
        "does not hold",
        "cannot be judged",
    ]
    assert "0.80× (0.70 to" in rows[0]
    assert lines[-2:] == ["1 holds, 1 holds in part, 1 does not hold, 1 cannot be judged", "page: a.html"]


@pytest.mark.slow
def test_json_on_standard_output_is_the_file(attlog, tmp_path: Path) -> None:
    done = attlog("reproduce", "lyu", "--seeds", "2", "-j", "1", "-o", tmp_path, "-q", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out) == json.loads((tmp_path / "reproduce-lyu.json").read_text(encoding="utf-8"))


def test_with_v_every_seed_is_a_line_where_there_is_no_terminal(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seeds(options: PaperOptions) -> Paper:
        each_seed("flights", abs, options)
        return replace(paper(), key="lyu")

    monkeypatch.setattr(lyu, "paper", seeds)
    for asked, lines in ((["-v"], [f"attlog: lyu: flights, {k} of 3" for k in (1, 2, 3)]), ([], [])):
        done = attlog("reproduce", "lyu", "--seeds", "3", "-j", "1", "-o", tmp_path, *asked)
        assert done.code == 0, done.err
        assert [line for line in done.err.splitlines() if " of 3" in line] == lines


def test_an_unknown_paper_is_2_with_the_known_ones(attlog, tmp_path: Path) -> None:
    done = attlog("reproduce", "lyi", "-o", tmp_path)
    assert (done.code, done.out) == (2, "")
    assert "did you mean lyu" in done.err


def test_a_log_that_is_not_there_is_66(attlog, tmp_path: Path) -> None:
    done = attlog("reproduce", "lyu", "--logs", tmp_path / "none.ulg", "-o", tmp_path)
    assert (done.code, "none.ulg" in done.err) == (66, True)
    assert not list(tmp_path.iterdir())


def test_logs_for_a_paper_without_are_2(attlog, tmp_path: Path) -> None:
    done = attlog("reproduce", "lyu", "--logs", SAMPLES, "-o", tmp_path)
    assert (done.code, "--logs" in done.err) == (2, True)


@pytest.mark.slow
def test_one_seed_alone_judges_nothing_by_an_interval(attlog, tmp_path: Path) -> None:
    done = attlog("reproduce", "lyu", "--seeds", "1", "-j", "1", "-o", tmp_path)
    assert done.code == 0, done.err
    told = json.loads((tmp_path / "reproduce-lyu.json").read_text(encoding="utf-8"))
    settle = next(c for c in told["claims"] if c["id"] == "settle")
    assert settle["verdict"] == "cannot be judged"
