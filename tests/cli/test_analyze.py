"""``attlog analyze`` from log to report, on the sample logs."""

from __future__ import annotations

import json

import jsonschema
import pytest

from attlog.result.document import complete_answers
from attlog.result.schema import schema
from tests.conftest import few
from tests.report.browser import executable

LOGS = ("px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog")


@pytest.fixture(scope="module", params=few(LOGS, 1))
def document(request, samples, tmp_path_factory):
    """The JSON document and the page of one sample log."""
    import attlog

    folder = tmp_path_factory.mktemp("out")
    result = attlog.analyze(samples / request.param, command="attlog analyze")
    result.to_html(folder / "r.html")
    return json.loads(result.to_json(folder / "r.json")), (folder / "r.html").read_text(encoding="utf-8")


def answers(document):
    complete_answers(document)
    for row in document["estimators"]:
        for window, metrics in row["metrics"].items():
            for metric, answer in metrics.items():
                yield row["name"], window, metric, answer


def test_the_document_follows_its_schema(document):
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.Draft202012Validator(schema()).validate(document[0])


def test_every_value_has_evidence_and_every_absence_a_reason(document):
    seen = 0
    for name, window, metric, answer in answers(document[0]):
        seen += 1
        where = (name, window, metric, answer)
        if "value" not in answer:
            assert answer["code"], where
            assert len(answer["reason"]) > 15, where
        else:
            assert answer["n"] > 0, where
            assert "ci95" in answer or "reason" in answer or "cost" in metric or answer["method"], where
            if "ci95" in answer:
                low, high = answer["ci95"]
                assert low <= answer["value"] <= high, where
    assert seen > 50


def test_default_rows_ran_and_the_corrected_filters_hold(document):
    rows = {r["name"]: r for r in document[0]["estimators"]}
    assert {"gyro", "complementary", "mahony", "vqf"} <= set(rows)
    for name in ("complementary", "mahony", "vqf"):
        assert rows[name]["status"] == "ok", (name, rows[name]["reason"])


@pytest.mark.slow
def test_deterministic_bytes_do_not_tell_how_the_command_was_spelled(attlog, samples, tmp_path, monkeypatch):
    log = samples / LOGS[0]
    monkeypatch.chdir(log.parent)
    for k, words in enumerate(
        [
            ["analyze", log, "--estimators", "gyro,mahony", "-q"],
            [log.name, "--gyro-bias", "rest", "--estimators=gyro, mahony", "-v", "--json"],
            ["batch", f"../{log.parent.name}/{log.name}", "--estimators", "gyro,mahony"],
        ]
    ):
        assert attlog(*words, "--deterministic", "--reference", "onboard", "-o", tmp_path / str(k)).code == 0
    for suffix in ("html", "json"):
        assert len({(tmp_path / str(k) / f"{log.name}.{suffix}").read_bytes() for k in range(3)}) == 1


def test_a_broken_plug_in_is_one_row_and_the_others_finish(attlog, samples, tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("raise RuntimeError('no good')\n")
    done = attlog("analyze", samples / LOGS[0], "-o", tmp_path / "out", "--estimators", f"gyro,{broken}", "--json", "-")
    assert done.code == 0, done.err
    rows = {r["name"]: r for r in json.loads(done.out)["estimators"]}
    assert rows["gyro"]["status"] in ("ok", "diverged")
    failed = [r for r in rows.values() if r["status"] == "failed"]
    assert len(failed) == 1
    assert "no good" in failed[0]["reason"]


def test_every_imu_is_replayed_when_asked_for(attlog, corpus, tmp_path):
    log = corpus / "sitl/ardupilot/copter_hover_rest.bin"
    done = attlog("analyze", log, "--imu", "all", "--estimators", "gyro", "-o", tmp_path, "--json", "-")
    assert done.code == 0, done.err
    names = {r["name"] for r in json.loads(done.out)["estimators"] if r["kind"] == "replay"}
    assert names == {"gyro/imu0", "gyro/imu1"}


@pytest.mark.slow
def test_without_a_magnetometer_filters_that_need_one_are_left_out(attlog, samples, tmp_path):
    done = attlog("analyze", samples / LOGS[0], "--mag", "none", "-o", tmp_path, "--json", "-")
    assert done.code == 0, done.err
    rows = {r["name"]: r for r in json.loads(done.out)["estimators"]}
    assert "ekf12" not in rows
    assert rows["vqf"]["uses_mag"] is False


def test_a_row_that_is_named_twice_stands_once(attlog, samples, tmp_path):
    config = tmp_path / "c.toml"
    config.write_text('estimators = ["gyro", "gyro,mahony@xu-0.6", "gyro"]\n')
    done = attlog("analyze", samples / LOGS[0], "--config", config, "-o", tmp_path, "--json", "-")
    assert done.code == 0, done.err
    names = [r["name"] for r in json.loads(done.out)["estimators"] if r["kind"] == "replay"]
    assert names == ["gyro", "mahony@xu-0.6"]


def test_figures_without_a_browser_are_refused_before_a_log_is_read(attlog, samples, tmp_path, monkeypatch):
    monkeypatch.setenv("BROWSER_PATH", str(tmp_path / "none"))
    done = attlog("analyze", samples / LOGS[0], "-o", tmp_path / "out", "--figures", tmp_path / "figures")
    assert done.code == 73
    assert "figures need Chrome, Chromium or Edge" in done.err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_figures_of_several_logs_stand_beside_each_other(attlog, samples, tmp_path, monkeypatch):
    monkeypatch.setenv("BROWSER_PATH", executable())
    figures = tmp_path / "figures"
    logs = [samples / name for name in LOGS[1:]]
    assert logs[0].stem == logs[1].stem
    options = ("--estimators", "gyro", "--reference", "onboard", "-o", tmp_path / "out", "--figures", figures)
    done = attlog("analyze", *logs, *options)
    assert done.code == 0, done.err
    assert f"figures: {figures}" in done.out
    stem = logs[0].stem
    assert {f"{stem}_attitude.svg", f"{stem}_attitude.png", f"{stem}-2_strip.svg"} <= {
        p.name for p in figures.iterdir()
    }
