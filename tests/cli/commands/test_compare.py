"""``attlog compare`` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from attlog.analysis import prepare
from attlog.analysis.config import Config
from attlog.base.errors import UsageError
from attlog.cli.commands.compare import printed
from attlog.compare.configurations.command_words import sorted_out, with_params
from attlog.compare.configurations.configuration import parse
from attlog.compare.differences.compare import compare
from attlog.compare.differences.comparison import Comparison
from attlog.compare.tables.table import side_by_side
from tests.compare.flights import comparison
from tests.conftest import SAMPLES

STEPS = SAMPLES / "copter_steps_stabilize.bin"


def test_two_settings_on_one_log(attlog, tmp_path: Path) -> None:
    done = attlog("compare", str(STEPS), "mahony:kp=0.3", "mahony:kp=0.6", "-o", str(tmp_path))
    assert done.code == 0, done.err
    found = Comparison.load(tmp_path / "compare.json")
    assert found.command.startswith("attlog compare")
    lead = " ".join(done.out.split("\n\n")[0].split())
    assert lead.startswith(found.verdicts[0].lead)
    assert (tmp_path / "compare.html").stat().st_size > 100_000
    assert (tmp_path / "compare.csv").read_text().startswith("metric,")
    tex = attlog("compare", str(STEPS), "mahony:kp=0.3", "mahony:kp=0.6", "-o", str(tmp_path), "--format", "tex")
    assert tex.out.count(r"\toprule") == len(found.questions)
    assert found.verdicts[0].lead in " ".join(tex.err.split())


def test_the_terminal_tells_all_logs_in_a_table_and_each_log_only_when_asked() -> None:
    logs = [SAMPLES / "copter_steps_stabilize.bin", SAMPLES / "copter_yaw_turns.bin"]
    found = compare(logs, [parse(f"mahony:kp={kp}") for kp in (0.3, 0.6)], Config())
    short, whole = ([line.text for line in printed(found, 80, verbose)] for verbose in (False, True))
    assert " ".join(short).startswith(found.verdicts[0].lead)
    rows = {line.split("  ")[0]: line.split() for line in short}
    assert rows["Noise added moving"][-4:] == ["worse", "0", "of", "1"]
    assert rows["Tilt error"][-4:] == ["no", "0", "of", "2"]
    assert not any(log.name in line for line in short for log in logs)
    assert all(any(log.name in line for line in whole) for log in logs)
    assert max(map(len, short)) <= 80
    assert len(short) < 16 < len(whole)


def test_json_goes_to_standard_output_and_the_tables_do_not(attlog, tmp_path: Path) -> None:
    done = attlog("compare", str(STEPS), "vqf", "mahony", "-o", str(tmp_path), "--json", "-")
    assert json.loads(done.out)["schema"] == "attlog-comparison/2"
    assert "Tilt error" in done.err


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
        (["{log}", "none.toml"], 66, "cannot be read"),
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
    found = sorted_out([str(STEPS), "logs/*.bin", "mahony@xu-0.6", "gyro", str(tmp_path / "c.toml")])
    assert [str(p) for p in found.logs] == [str(STEPS), "logs/*.bin"]
    assert [c.name for c in found.wanted.configurations] == ["mahony@xu-0.6", "gyro", "mine"]
    assert found.wanted.metrics == ["lag_ms"]
    with pytest.raises(UsageError) as error:
        sorted_out(["mahoni", "mahony:kpp=1"])
    assert len(str(error.value).splitlines()) == 2


def test_other_firmware_parameters_are_those_of_the_filter_itself(attlog, tmp_path: Path) -> None:
    """The same as the filter with that gain set by hand, and the filter is found by the file's own names."""
    new = tmp_path / "new.params"
    new.write_text("1\t1\tATT_W_ACC\t0.8\t9\n")
    log = str(SAMPLES / "px4_steps.ulg")
    by_hand = "px4_q:ATT_W_ACC=0.8"
    assert attlog("compare", log, "--params", str(new), "-o", str(tmp_path), "-q").code == 0
    found = Comparison.load(tmp_path / "compare.json")
    assert [c.name for c in found.configurations] == ["px4_q", f"px4_q:params={new}"]
    assert attlog("compare", log, by_hand, f"px4_q:params={new}", "px4_q", "-o", str(tmp_path), "-q").code == 0
    same, other = Comparison.load(tmp_path / "compare.json").verdicts
    assert same.lead.startswith("No difference")
    assert not other.lead.startswith("No difference")


def test_a_calibration_in_a_file_is_one_for_every_filter_that_runs(tmp_path: Path) -> None:
    new = tmp_path / "new.param"
    new.write_text("COMPASS_OFS_X,100\n")
    csv = tmp_path / "estimate.csv"
    csv.write_text("t,qw,qx,qy,qz\n0,1,0,0,0\n")
    found = with_params([parse("mahony"), parse("vqf"), parse(str(csv))], new)
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
    late_ms = next(step.value for step in case.reference.steps if step.name == "input_delay")
    done = attlog("compare", str(STEPS), spec, f"{file}:delay={late_ms}", "mahony", "-o", str(tmp_path), "-q")
    assert done.code == 0, done.err
    found = Comparison.load(tmp_path / "compare.json")
    for question in found.questions:
        cells = question.cells[STEPS.name]
        if cells[spec].value is not None and question.metric != "drift_rest_deg_per_min":
            assert cells[found.configurations[1].name].value == pytest.approx(cells[spec].value, rel=1e-3, abs=1e-3)
    done = attlog("analyze", str(STEPS), "--estimators", f"mahony:kp=0.3,{file}", "-o", str(tmp_path))
    assert done.code == 0, done.err
    rows = {r["name"]: r for r in json.loads((tmp_path / f"{STEPS.name}.json").read_text())["estimators"]}
    assert rows["estimate"]["quality"]["frame"] == "ned-frd"
    tilt = [rows[n]["metrics"]["airborne"]["inclination_rmse_deg"]["value"] for n in (spec, "estimate")]
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
    found = {form: attlog(*words, "--format", form) for form in ("csv", "tex", "md")}
    assert {done.code for done in found.values()} == {0}
    lines = found["csv"].out.splitlines()
    assert lines[0].startswith('filter,"Tilt error RMS, °"')
    assert any(line.startswith("Madgwick,") for line in lines)
    assert "Madgwick & " in found["tex"].out
    assert "| Madgwick | " in found["md"].out
    assert "report: " in found["md"].err


def test_files_are_written_together_or_the_old_ones_stay(attlog, tmp_path: Path) -> None:
    for name in ("compare.html", "compare.json"):
        (tmp_path / name).write_text("old")
    (tmp_path / "compare.csv").mkdir()
    done = attlog("compare", str(STEPS), "gyro", "mahony", "--reference", "onboard", "-o", str(tmp_path))
    assert (done.code, "compare.csv: cannot be written" in done.err) == (73, True), done.err
    assert [(tmp_path / name).read_text() for name in ("compare.html", "compare.json")] == ["old", "old"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["compare.csv", "compare.html", "compare.json"]


def test_the_sentence_stands_first_and_last_and_several_configurations_side_by_side() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.01)] * 9, "noise_tilt_deg": [(3.0, 0.01)] * 9})
    lines = [line.text for line in printed(found, 80)]
    lead = " ".join(lines[: lines.index("")])
    assert lead == found.verdicts[0].lead
    assert " ".join(lines[-len(lines[: lines.index("")]) :]) == lead
    assert len(lines) + 1 <= 25
    (table,) = side_by_side(found, 80)
    assert table.rows == [("Tilt error", "+35 %*", ""), ("Noise at rest", "20 times*", "")]
