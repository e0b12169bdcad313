"""``--gates`` of analyze and batch; ``--strict``, ``--junit`` and ``--summary`` of batch."""

from __future__ import annotations

from pathlib import Path

import pytest
from junitparser import JUnitXml

from attlog.cli.commands.filters import RUN_TEMPLATE
from tests.conftest import SAMPLES, few

LOG = SAMPLES / "px4_steps.ulg"
FAST = ("--estimators", "mekf,gyro", "--reference", "truth")
NAN = RUN_TEMPLATE.replace("return Estimate(t=t, q=q)", "return Estimate(t=t, q=np.full_like(q, np.nan))")
ACROSS = RUN_TEMPLATE.replace(
    "return Estimate(t=t, q=q)",
    """w, x, y, z = q.T
    half = np.radians(95.0) / 2.0  # turned by 95 deg about the vertical
    c, s = np.cos(half), np.sin(half)
    return Estimate(t=t, q=np.column_stack((c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)))""",
)
CRASH = "import nothing_of_that_name\n"


@pytest.fixture
def gates(tmp_path: Path):
    def write(text: str) -> Path:
        (tmp_path / "gates.toml").write_text(f"[gates]\n{text}\n")
        return tmp_path / "gates.toml"

    return write


@pytest.fixture(params=["analyze", pytest.param("batch", marks=pytest.mark.slow)])
def command(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.slow
def test_green_is_0_and_red_is_1_with_the_sentence(attlog, command: str, gates, tmp_path: Path) -> None:
    args = (command, LOG, *FAST, "-o", tmp_path / "out", "--gates")
    more = () if command == "analyze" else ("--resume",)
    done = attlog(*args, gates("lag_ms = { max = 5 }"), *more)
    assert (done.code, "failed" in done.out) == (0, False), done.err
    assert ("gates: 2 passed" if command == "analyze" else "gates: 2 of 2 passed") in done.out
    done = attlog(*args, gates("total_p95_deg = { max = 0.5 }"), *more)
    assert done.code == 1
    assert "mekf: total_p95_deg 2.6° (airborne), at most 0.5°" in done.out + done.err
    page = (tmp_path / "out" / "px4_steps.ulg.html").read_text(encoding="utf-8")
    assert "<b>Gates: 1 of 2 checks failed.</b> mekf: total_p95_deg 2.6° (airborne), at most 0.5°" in page


@pytest.mark.slow
def test_other_gates_need_no_new_analysis_and_the_page_follows(attlog, gates, tmp_path: Path) -> None:
    args = ("batch", LOG, *FAST, "-o", tmp_path / "out", "--resume", "-v", "--gates")
    assert attlog(*args, gates("lag_ms = { max = 5 }")).code == 0
    for text, code in (("total_p95_deg = { max = 0.5 }", 1), ("lag_ms = { max = 5 }", 0)):
        done = attlog(*args, gates(text))
        assert done.code == code
        assert "done before" in done.err
        page = (tmp_path / "out" / "px4_steps.ulg.html").read_text(encoding="utf-8")
        assert ("<b>Gates: 1 of 2" in page) == bool(code)


def test_quiet_says_what_failed_on_standard_error(attlog, command: str, gates, tmp_path: Path) -> None:
    done = attlog(command, LOG, *FAST, "-q", "-o", tmp_path / "out", "--gates", gates("total_p95_deg = { max = 0.5 }"))
    assert (done.code, done.out) == (1, "")
    assert done.err.splitlines() == [f"attlog: {LOG}: gate: mekf: total_p95_deg 2.6° (airborne), at most 0.5°"]


def test_a_wrong_gate_file_is_2_before_anything_is_analysed(attlog, command: str, gates, tmp_path: Path) -> None:
    done = attlog(command, LOG, "-o", tmp_path / "out", "--gates", gates("lagms = { max = 5 }\nlag_ms = { maxx = 1 }"))
    assert done.code == 2
    assert "did you mean lag_ms?" in done.err
    assert "did you mean max?" in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_log_that_cannot_be_read_is_an_error_and_its_code_wins(attlog, gates, tmp_path: Path) -> None:
    (tmp_path / "no.ulg").write_bytes(b"no log at all")
    report = tmp_path / "junit.xml"
    logs = (tmp_path / "no.ulg", LOG, tmp_path / "gone.ulg")
    text = "total_p95_deg = { max = 0.5 }"
    done = attlog("batch", *logs, *FAST, "-o", tmp_path / "out", "--gates", gates(text), "--junit", report)
    assert done.code == 66
    suites = {Path(s.name).name: (s.tests, s.failures, s.errors) for s in JUnitXml.fromfile(str(report))}
    assert suites == {"no.ulg": (1, 0, 1), "px4_steps.ulg": (3, 1, 0), "gone.ulg": (1, 0, 1)}
    done = attlog("batch", tmp_path / "none*.ulg", "-o", tmp_path / "out2", "--junit", report)
    assert done.code == 66
    assert [s.errors for s in JUnitXml.fromfile(str(report))] == [1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "word"),
    few([(CRASH, "nothing_of_that_name"), (NAN, "no finite attitude"), (ACROSS, "heading error above 45 deg")], 1),
    ids=["crash", "nan", "across"],
)
def test_strict_ends_with_1_where_a_filter_crashes_returns_nan_or_stands_across(
    attlog, tmp_path: Path, text: str, word: str
) -> None:
    (tmp_path / "mine.py").write_text(text)
    args = ("batch", LOG, "--estimators", f"mekf,{tmp_path / 'mine.py'}", "-o")
    assert attlog(*args, tmp_path / "a").code == 0
    done = attlog(*args, tmp_path / "b", "--strict")
    assert done.code == 1
    told = (done.out + done.err).splitlines()
    (line,) = [line for line in told if line.startswith("  failed   ") or f"{LOG}: gate: " in line]
    assert word in line


@pytest.mark.slow
def test_the_summary_goes_to_a_file_to_the_step_or_to_the_terminal(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    args = ("batch", LOG, "--estimators", "gyro", "-q", "-o")
    done = attlog(*args, tmp_path / "b", "--summary", tmp_path / "s.md")
    assert (done.code, done.out) == (0, "")
    assert (tmp_path / "s.md").read_text(encoding="utf-8").startswith("## ✅")
    step = tmp_path / "step"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    assert attlog("batch", "--summary", LOG, "--estimators", "gyro", "-q", "-o", tmp_path / "c").out == ""
    assert step.read_text(encoding="utf-8").startswith("## ✅")
    assert attlog(*args, tmp_path / "d", "--summary=s.txt").code == 2


@pytest.mark.parametrize("wrong", ["gates", "config"])
def test_what_is_wrong_with_gates_and_options_is_told_where_ci_looks(
    attlog, gates, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: str
) -> None:
    """The step was red, with no annotation and an empty summary."""
    (tmp_path / "c.toml").write_text("imuu = 0\n")
    option = ["--gates", gates("overshot = { max = 5 }")] if wrong == "gates" else ["--config", tmp_path / "c.toml"]
    word = "overshot" if wrong == "gates" else "imuu"
    step = tmp_path / "step"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    done = attlog("batch", LOG, *option, "-o", tmp_path / "out", "--summary")
    assert done.code == 2
    annotation = next(line for line in done.err.splitlines() if line.startswith("::error "))
    assert word in annotation
    assert step.read_text(encoding="utf-8").startswith("## ❌ attlog: nothing was analysed")
    assert word in step.read_text(encoding="utf-8")
    monkeypatch.delenv("GITHUB_ACTIONS")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY")
    done = attlog("batch", LOG, *option, "-o", tmp_path / "out", "--summary", tmp_path / "s.md")
    assert "::error" not in done.err
    assert word in (tmp_path / "s.md").read_text(encoding="utf-8")


def test_an_option_that_there_is_not_is_told_where_ci_looks(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = tmp_path / "step"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    done = attlog("batch", LOG, "--gatez", "g.toml", "-o", tmp_path / "out", "--summary")
    assert done.code == 2
    assert any(line.startswith("::error ") and "--gatez" in line for line in done.err.splitlines())
    assert "--gatez" in step.read_text(encoding="utf-8")
    monkeypatch.delenv("GITHUB_ACTIONS")
    assert "::error" not in attlog("batch", LOG, "--gatez", "g.toml").err


@pytest.mark.slow
def test_json_lines_are_a_baseline(attlog, gates, tmp_path: Path) -> None:
    logs = (LOG, SAMPLES / "px4_hover.ulg")
    lines = attlog("analyze", *logs, *FAST, "-o", tmp_path / "out", "--json", "-q").out
    (tmp_path / "main.jsonl").write_text(lines, encoding="utf-8")
    text = 'baseline = "main.jsonl"\ntilt_rmse_deg = { baseline = true }'
    report = tmp_path / "junit.xml"
    done = attlog("batch", *logs, *FAST, "-o", tmp_path / "b", "--gates", gates(text), "--junit", report)
    assert done.code == 0, done.out + done.err
    for suite in JUnitXml.fromfile(str(report)):
        assert "mekf: tilt_rmse_deg not worse than baseline" in {case.name for case in suite}


def test_an_output_that_cannot_be_written_is_73(attlog, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    done = attlog("batch", LOG, "--estimators", "gyro", "-o", tmp_path / "out", "--junit", tmp_path / "file" / "j.xml")
    assert done.code == 73
