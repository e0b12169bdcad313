"""``attlog compare`` as a user types it."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from attlog.cli.commands.compare import comparison_lines
from attlog.cli.logs import PreparedLogs
from attlog.cli.options import ComparisonOptions
from attlog.compare.comparison import LogLine, select_questions
from attlog.compare.setting import parse_configuration
from attlog.compare.setting_words import select_words, with_params_file
from attlog.compare.tables import pooled_tables
from attlog.core.errors import UsageError
from attlog.estimators import get
from attlog.pipeline import prepare
from attlog.pipeline.config import Config
from tests.compare.made import CONFIGURATIONS, comparison, filtered, result
from tests.conftest import SAMPLES
from tests.words.made import lag, merged, row, tilt
from tests.words.made import result as made_result

STEPS = SAMPLES / "copter_steps_stabilize.bin"


def saved(folder: Path) -> Any:
    """Return the JSON of a comparison, its objects with attributes."""
    text = (folder / "compare.json").read_text(encoding="utf-8")
    return json.loads(text, object_hook=lambda entries: SimpleNamespace(**entries))


def test_two_settings_on_one_log(attlog, tmp_path: Path) -> None:
    done = attlog("compare", str(STEPS), "mahony:kp=0.3", "mahony:kp=0.6", "-o", str(tmp_path))
    assert done.code == 0, done.err
    found = saved(tmp_path)
    assert found.command.startswith("attlog compare")
    lead = " ".join(done.out.split("\n\n")[0].split())
    assert lead.startswith(found.verdicts[0].lead)
    assert (tmp_path / "compare.html").stat().st_size > 100_000
    assert (tmp_path / "compare.csv").read_text().startswith("metric,")
    more = ("mahony:kp=0.3", "mahony:kp=0.6", "-o", str(tmp_path))
    tex = attlog("compare", str(STEPS), *more, "--format", "tex")
    assert tex.out.count(r"\toprule") == len(found.questions)
    assert found.verdicts[0].lead in " ".join(tex.err.split())
    assert json.loads(attlog("compare", str(STEPS), *more, "--json", "-").out)["schema"] == "attlog-comparison/3"


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["{log}", "mahony"], 2, "two configurations or more"),
        (["mahony", "vqf"], 2, "no log named"),
        (["{log}", "mahony", "mahoni"], 2, "neither a file nor a filter; did you mean mahony?"),
        (["{log}", "mahony:kpp=1", "vqf:lowpas=2"], 2, "did you mean lowpass?"),
        (["{log}", "mahony", "vqf", "--metric", "lagms"], 2, "did you mean lag_ms?"),
        (["{log}", "mahony", "vqf", "--format", "xls"], 2, "'md', 'csv', 'tex'"),
        (["{log}", "mahony", "vqf", "--reference", "thruth"], 2, "must be auto, truth"),
        (["{log}", "none.toml"], 66, "no such file"),
        (["none.bin", "mahony", "vqf"], 66, "none.bin"),
    ],
)
def test_what_is_wrong_is_said_with_the_right_exit_code(
    attlog, tmp_path: Path, words: list[str], code: int, said: str
) -> None:
    done = attlog("compare", *(w.format(log=STEPS) for w in words), "-o", str(tmp_path))
    assert done.code == code, done.err
    assert said in done.err


def test_words_are_told_apart_by_what_they_look_like(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("metrics=['lag_ms']\n[[configuration]]\nestimator='vqf'\nname='mine'\n")
    found = select_words([str(STEPS), "logs/*.bin", "mahony@xu-0.6", "gyro", str(tmp_path / "c.toml")])
    assert [str(p) for p in found.logs] == [str(STEPS), "logs/*.bin"]
    assert [c.name for c in found.configurations] == ["mahony@xu-0.6", "gyro", "mine"]
    assert found.metrics == ["lag_ms"]
    with pytest.raises(UsageError) as error:
        select_words(["mahoni", "mahony:kpp=1"])
    assert len(str(error.value).splitlines()) == 2


def test_other_firmware_parameters_are_those_of_the_filter_itself(attlog, tmp_path: Path) -> None:
    """The same as the filter with that gain set by hand, and the filter is found by the file's own names."""
    new = tmp_path / "new.params"
    new.write_text("1\t1\tATT_W_ACC\t0.8\t9\n")
    log = str(SAMPLES / "px4_steps.ulg")
    by_hand = "px4_q:ATT_W_ACC=0.8"
    assert attlog("compare", log, "--params", str(new), "-o", str(tmp_path), "-q").code == 0
    found = saved(tmp_path)
    assert [c.name for c in found.configurations] == ["px4_q", f"px4_q:params={new}"]
    assert attlog("compare", log, by_hand, f"px4_q:params={new}", "px4_q", "-o", str(tmp_path), "-q").code == 0
    same, other = saved(tmp_path).verdicts
    assert same.lead.startswith("No difference")
    assert not other.lead.startswith("No difference")


def test_a_calibration_in_a_file_is_one_for_every_filter_that_runs(tmp_path: Path) -> None:
    new = tmp_path / "new.param"
    new.write_text("COMPASS_OFS_X,100\n")
    csv = tmp_path / "estimate.csv"
    csv.write_text("t,qw,qx,qy,qz\n0,1,0,0,0\n")
    found = with_params_file(
        [parse_configuration("mahony"), parse_configuration("vqf"), parse_configuration(str(csv))], new
    )
    assert [c.name.split(":params")[0] for c in found] == ["mahony", "mahony", "vqf", "vqf", str(csv)]
    assert [c.params for c in found] == [None, new, None, new, None]


def test_a_file_that_fits_no_filter_is_refused(attlog, tmp_path: Path) -> None:
    new = tmp_path / "new.param"
    new.write_text("FOO,1\n")
    for words in (["mahony", "vqf"], []):
        done = attlog("compare", str(STEPS), *words, "--params", str(new), "-o", str(tmp_path))
        assert (done.code, "name a filter that takes these parameters" in done.err) == (2, True)
    assert attlog("compare", str(STEPS), "--params", str(tmp_path / "none"), "-o", str(tmp_path)).code == 66


@pytest.mark.slow
def test_a_filters_own_output_as_a_file_is_equal_to_the_filter(attlog, tmp_path: Path) -> None:
    """Written by extract, read as an estimate: in compare and in analyze one more row with the same numbers."""
    file = tmp_path / "estimate.csv"
    spec = "mahony:kp=0.3"
    assert attlog("extract", str(STEPS), "--estimates", spec, "--format", "csv", "-o", str(file)).code == 0
    # the IMU's own delay is subtracted from a filter that attlog runs; a file says how late its samples are
    case = prepare(STEPS, Config())
    late_ms = next(step.value for step in case.reference.alignment.steps if step.name == "input_delay")
    done = attlog("compare", str(STEPS), spec, f"{file}:delay={late_ms}", "mahony", "-o", str(tmp_path), "-q")
    assert done.code == 0, done.err
    found = saved(tmp_path)
    for question in found.questions:
        cells = vars(vars(question.cells)[STEPS.name])
        if cells[spec].value is not None and question.metric != "drift_rest_deg_per_min":
            assert cells[found.configurations[1].name].value == pytest.approx(cells[spec].value, rel=1e-3, abs=1e-3)
    done = attlog("analyze", str(STEPS), "--estimators", f"mahony:kp=0.3,{file}", "-o", str(tmp_path))
    assert done.code == 0, done.err
    rows = {r["name"]: r for r in json.loads((tmp_path / f"{STEPS.name}.json").read_text())["estimators"]}
    assert rows["estimate"]["quality"]["frame"] == "ned-frd"
    tilt = [rows[n]["metrics"]["airborne"]["tilt_rmse_deg"]["value"] for n in (spec, "estimate")]
    assert tilt[1] == pytest.approx(tilt[0], rel=1e-4)


def test_an_estimate_of_another_log_is_a_row_with_its_reason(attlog, tmp_path: Path) -> None:
    file = tmp_path / "estimate.csv"
    file.write_text("t,qw,qx,qy,qz\n" + "\n".join(f"{1000 + 0.01 * k},1,0,0,0" for k in range(1000)))
    done = attlog("compare", str(STEPS), "mahony", str(file), "-o", str(tmp_path))
    assert done.code == 0
    assert "does not overlap the log" in " ".join(done.out.split())
    assert attlog("compare", str(STEPS), "mahony", f"{file}:frame=xyz", "-o", str(tmp_path)).code == 2


@pytest.mark.slow
def test_the_table_of_analyze_is_printed_for_a_paper(attlog, tmp_path: Path) -> None:
    words = ("analyze", str(STEPS), "--estimators", "mahony,madgwick", "-o", str(tmp_path))
    found = {form: attlog(*words, "--format", form) for form in ("csv", "tex")}
    assert {done.code for done in found.values()} == {0}
    lines = found["csv"].out.splitlines()
    assert lines[0].startswith('filter,"Tilt error RMS, °"')
    assert any(line.startswith("Madgwick,") for line in lines)
    assert "Madgwick & " in found["tex"].out
    assert "report: " in found["tex"].err


def test_the_sentence_stands_first_once_and_several_configurations_side_by_side() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.01)] * 9, "noise_tilt_deg": [(3.0, 0.01)] * 9})
    lines = [line.text for line in comparison_lines(found, 80)]
    lead = " ".join(lines[: lines.index("")])
    assert lead == found.verdicts[0].lead
    assert " ".join(lines).count(lead) == 1
    assert len(lines) + 1 <= 25
    three = comparison(
        {"tilt_rmse_deg": [(0.3, 0.01)] * 9}, [*CONFIGURATIONS, parse_configuration("mahony:kp=2")], factors=(1.0, 0.0)
    )
    (table,) = pooled_tables(three, 80)
    assert table.rows == [("Tilt error", "+35 %*", "0 ", "")]
    assert [len(t.head) for t in pooled_tables(three, 20)] == [3, 3]


def test_what_is_asked_for_is_answered_and_a_log_without_an_answer_is_named() -> None:
    noise = next(q for q in select_questions(["all"]) if not q.main)
    found = comparison({noise.metric: [(3.0, 0.01)] * 2}, questions=[noise])
    found.logs.append(LogLine("still.ulg", "still.ulg"))
    lines = [line.text for line in comparison_lines(found, 80)]
    assert "cannot be compared" not in " ".join(lines)
    assert lines[0].startswith("mahony:kp=2") or " is significantly " in lines[0]
    assert any(line.endswith(", 2 of 3 logs") for line in lines)
    assert "no answer: still.ulg" in lines


# ``attlog diff``: exit codes, formats, old schemas.


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    paths = tmp_path / "old.json", tmp_path / "new.json"
    for path, value in zip(paths, (1.0, 9.0), strict=True):
        result(filtered(lag(value))).to_json(path)
    return paths


def test_equal_is_0_and_a_difference_is_1(attlog, two: tuple[Path, Path]) -> None:
    same = attlog("diff", two[0], two[0])
    assert (same.code, same.err) == (0, "")
    assert "no difference" in same.out
    done = attlog("diff", *two)
    assert done.code == 1
    assert "lag_ms" in done.out
    assert "worse" in done.out
    assert attlog("diff", *two, "--tolerance", "lag_ms=8").code == 0
    assert attlog("diff", *two, "--tolerance", "lag_ms=7.9").code == 1
    assert attlog("diff", *two, "--window", "airborne").code == 1


def test_a_diff_goes_to_the_terminal_or_to_a_file(attlog, two: tuple[Path, Path], tmp_path: Path) -> None:
    found = json.loads(attlog("diff", *two, "--json").out)
    assert found["schema"] == "attlog-diff/2"
    assert found["logs"][0]["moved"][0]["new"] == 9.0
    done = attlog("diff", *two, "--format", "md", "-o", tmp_path / "x.md")
    assert (done.code, done.out) == (1, "")
    assert r"| mahony | airborne | lag\_ms |" in (tmp_path / "x.md").read_text(encoding="utf-8")


def test_a_folder_gets_the_page_and_its_json(attlog, two: tuple[Path, Path], tmp_path: Path) -> None:
    done = attlog("diff", *two, "-o", tmp_path / "out")
    assert done.code == 1
    assert "lag_ms" in done.out
    assert "diff.html" in done.out
    assert json.loads((tmp_path / "out/diff.json").read_text(encoding="utf-8"))["count"] == 1
    assert "old.json to new.json" in (tmp_path / "out/diff.html").read_text(encoding="utf-8")


def test_wrong_usage_is_2_and_files_that_cannot_be_used_are_65_and_66(
    attlog, two: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "no.json").write_text("{}")
    for arguments, code, word in (
        ((*two, "--format", "xml"), 2, "'md'"),
        ((*two, "--tolerance", "lagms=1"), 2, "did you mean lag_ms"),
        ((*two, "--window", "flight"), 2, "airborne"),
        ((two[0], tmp_path), 2, "two folders"),
        ((two[0], tmp_path / "no.json"), 65, "no schema"),
        ((two[0], tmp_path / "none.json"), 66, "no such file"),
    ):
        done = attlog("diff", *arguments)
        assert (done.code, word in done.err, done.out) == (code, True, ""), (arguments, done)


# ``attlog sweep``: files, tables and exit codes.

LOG = SAMPLES / "px4_steps.ulg"


def test_a_sweep_writes_page_json_and_csv_and_prints_the_table(attlog, tmp_path: Path) -> None:
    done = attlog("sweep", LOG, "mahony", "kp=0.2,0.6", "-o", tmp_path, "--format", "tex")
    assert done.code == 0, done.err
    assert "Tilt error: best setting kp" in done.err
    assert {p.name for p in tmp_path.iterdir()} == {"sweep-mahony.html", "sweep-mahony.json", "sweep-mahony.csv"}
    found = json.loads((tmp_path / "sweep-mahony.json").read_text())
    assert [s["values"] for s in found["settings"]] == [{"kp": 0.2}, {"kp": 0.6}, {}]
    assert found["logs"][0]["reference"] == "truth"
    assert "toprule" in done.out


def test_wrong_usage_is_2_with_everything_that_is_wrong(attlog, tmp_path: Path) -> None:
    assert attlog("sweep", tmp_path / "none.ulg", "mahony", "kp=1").code == 66
    for arguments, words in (
        ((LOG, "mahony", "kp=x", "kj=1", "--metric", "tilt"), ("kp=x", "kj", "no metric tilt")),
        ((LOG, "mahonny", "kp=1"), ("mean mahony",)),
        ((LOG, "kp=1"), ("filter",)),
        ((LOG, "mahony"), ("nothing to sweep",)),
        ((LOG, "mahony", "kp=1", "--format", "doc"), ("'tex'",)),
        ((LOG, "mahony", "kp=1", "--metric", "noise_tilt_deg@flight", "-o", tmp_path), ("noise_tilt_deg@flight",)),
        ((LOG, "mahony", "kp=0..2/100", "ki=0..1/100"), ("10,000 settings",)),
    ):
        done = attlog("sweep", *arguments)
        assert (done.code, done.out) == (2, ""), (arguments, done)
        assert all(word in done.err for word in words), (arguments, done.err)


def test_a_flight_that_is_given_twice_is_swept_once_and_both_are_named(attlog, tmp_path: Path) -> None:
    again = tmp_path / "again.ulg"
    again.write_bytes(LOG.read_bytes())
    (tmp_path / "bad.bin").write_bytes(b"\0" * 5000)
    done = attlog("sweep", tmp_path / "bad.bin", LOG, again, "mahony", "kp=0.3,0.6", "-o", tmp_path, "--json")
    assert (done.code, "bad.bin" in done.err) == (65, True), done.err
    assert f"again.ulg and {LOG.name} are one flight: only {LOG.name} counts" in done.err
    assert [log["name"] for log in json.loads(done.out)["logs"]] == [LOG.name]


def test_the_log_of_a_radio_comes_last_for_of_one_flight_the_card_counts() -> None:
    card, radio = SAMPLES / "copter_steps_stabilize.bin", next(SAMPLES.glob("*.tlog"))
    assert PreparedLogs([radio, card], ComparisonOptions())._logs == [card, radio]


# ``attlog tune``: files, exit codes.

LOGS = (SAMPLES / "px4_steps.ulg", SAMPLES / "copter_yaw_turns.bin")


@pytest.mark.slow
def test_gains_come_with_page_and_json_and_the_same_again(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("attlog.compare.tune.GENERATIONS", 1)
    arguments = (*LOGS, "mahony", "kp=0.1..2log", "--objective", "tilt")
    done = attlog("tune", *arguments, "-o", tmp_path)
    assert done.code == 0, done.err
    assert "mahony:kp=" in done.out
    assert {p.name for p in tmp_path.iterdir()} == {"tune-mahony.html", "tune-mahony.json"}
    found = json.loads((tmp_path / "tune-mahony.json").read_text())
    assert found["as_it_is"] == {"kp": next(p.default for p in get("mahony").own if p.name == "kp")}
    assert [f["left_out"] for f in found["folds"]] == [["px4_steps.ulg"], ["copter_yaw_turns.bin"]]
    again = json.loads(attlog("tune", *arguments, "-o", tmp_path, "--json", "-q").out)
    assert again["gains"] == found["gains"]
    assert again["tried"] == found["tried"]


def test_wrong_usage_of_tune_is_2_with_everything_that_is_wrong(attlog, tmp_path: Path) -> None:
    for arguments, words in (
        ((*LOGS, "mahony", "kp=1", "--objective", "tild=1"), ("give a range", "mean tilt")),
        ((*LOGS, "mahonny"), ("mean mahony",)),
        ((LOGS[0],), ("filter",)),
        ((*LOGS, "gyro"), ("no gains",)),
    ):
        done = attlog("tune", *arguments, "-o", tmp_path)
        assert (done.code, done.out) == (2, ""), (arguments, done)
        assert all(word in done.err for word in words), (arguments, done.err)


# ``attlog table``: what it prints and writes, exit codes.


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three results."""
    for i, value in enumerate((1.0, 2.0, 6.0)):
        rows = [row("mekf", merged(tilt(value), lag(value))), row("mahony@xu-0.6", tilt(2 * value)), row("onboard", {})]
        made = made_result(rows, name=f"log{i}.ulg", sha256=str(i), vehicle="quadrotor")
        made.to_json(tmp_path / f"log{i}.ulg.json")
    return tmp_path


def test_a_line_for_each_log_with_the_middle_below(attlog, folder: Path) -> None:
    done = attlog("table", folder, "--metric", "tilt_rmse_deg")
    lines = done.out.splitlines()
    assert (done.code, done.err) == (0, "")
    assert lines[0] == "tilt_rmse_deg, airborne, in °"
    assert lines[1].split() == ["log", "date", "mahony@xu-0.6", "mekf"]
    assert [line.split() for line in lines[2:]] == [
        ["log0.ulg", "2.0", "1.0"],
        ["log1.ulg", "4.0", "2.0"],
        ["log2.ulg", "12.0", "6.0"],
        ["median", "4.0", "2.0"],
        ["25", "%", "3.0", "1.5"],
        ["75", "%", "8.0", "4.0"],
        ["logs", "3", "3"],
    ]
    assert not [line for line in lines if line != line.rstrip()]


def test_formats_go_to_the_terminal_or_to_a_file(attlog, folder: Path, tmp_path: Path) -> None:
    lines = list(csv.DictReader(io.StringIO(attlog("table", folder, "--format", "csv", "--row", "mekf").out)))
    assert [(x["log"], float(x["mekf"]), x["vehicle"]) for x in lines] == [
        ("log0.ulg", 1.0, "quadrotor"),
        ("log1.ulg", 2.0, "quadrotor"),
        ("log2.ulg", 6.0, "quadrotor"),
    ]
    for suffix, expected in (("md", "| median |  | 2.0 |"), ("tex", r"log0.ulg &  & 1.0 \\"), ("txt", "log0.ulg")):
        path = tmp_path / f"out.{suffix}"
        done = attlog("table", folder, "--row", "mekf", "-o", path)
        assert (done.code, done.out) == (0, "")
        assert expected in path.read_text(encoding="utf-8")


def test_parquet_names_metric_window_and_unit_of_each_column(attlog, folder: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "out.parquet"
    assert attlog("table", folder, "--metric", "tilt_rmse_deg,lag_ms", "-o", path).code == 0
    table = parquet.read_table(path)
    assert table["lag_ms mekf"].to_pylist() == [1.0, 2.0, 6.0]
    about = table.schema.field("lag_ms mekf").metadata
    assert (about[b"unit"], about[b"window"], about[b"row"]) == (b"ms", b"airborne", b"mekf")
    assert attlog("table", folder, "--by", "vehicle", "-o", path).code == 0
    assert parquet.read_table(path)["mekf median"].to_pylist() == [2.0]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--by", "colour"], "use firmware"),
        (["--format", "xls"], "use md, csv"),
        (["-o", "x.xlsx"], "use md, csv"),
        (["--format", "parquet"], "needs a file"),
        (["--metric", "lag_ms@hovering"], "--metric lag_ms@hovering: no log has this window"),
    ],
)
def test_wrong_options_are_refused_with_what_is_meant(attlog, folder: Path, options: list[str], text: str) -> None:
    done = attlog("table", folder, *options)
    assert (done.code, done.out) == (2, "")
    assert text in done.err


def test_what_cannot_be_used_is_told_and_the_rest_is_shown(attlog, folder: Path) -> None:
    (folder / "broken.json").write_text('{"schema": "attlog-result/2", ')
    done = attlog("table", folder)
    assert done.code == 65
    assert "broken.json" in done.err
    assert "log0.ulg" in done.out
    assert attlog("table", folder / "none").code == 66


def test_columns_that_do_not_fit_are_named(attlog, folder: Path) -> None:
    rows = [row(f"filter{i}@with-a-long-name", tilt(1.0 + i)) for i in range(12)]
    made_result(rows, name="wide.ulg", sha256="wide").to_json(folder / "wide.ulg.json")
    out = attlog("table", folder / "wide.ulg.json").out.splitlines()
    assert max(map(len, out[:-1])) <= 160
    assert out[-1].startswith("No room for filter")
