"""``attlog sweep``: files, tables and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

from tests.conftest import SAMPLES

LOG = SAMPLES / "px4_steps.ulg"


def test_a_sweep_writes_page_json_and_csv_and_prints_the_table(attlog, tmp_path: Path) -> None:
    done = attlog("sweep", LOG, "mahony", "kp=0.2,0.6", "-o", tmp_path, "--format", "tex")
    assert done.code == 0, done.err
    assert "Tilt error RMS: best setting kp" in done.err
    assert {p.name for p in tmp_path.iterdir()} == {"sweep-mahony.html", "sweep-mahony.json", "sweep-mahony.csv"}
    found = json.loads((tmp_path / "sweep-mahony.json").read_text())
    assert [s["values"] for s in found["settings"]] == [{"kp": 0.2}, {"kp": 0.6}, {}]
    assert found["logs"][0]["reference"] == "truth"
    assert "toprule" in done.out


def test_one_broken_log_of_many_is_told_and_the_others_are_swept(attlog, tmp_path: Path) -> None:
    (tmp_path / "bad.bin").write_bytes(b"\0" * 5000)
    done = attlog("sweep", tmp_path / "bad.bin", LOG, "mahony", "kp=0.3,0.6", "-o", tmp_path, "--json")
    assert done.code == 65
    assert "bad.bin" in done.err
    assert len(json.loads(done.out)["logs"]) == 1


def test_wrong_usage_is_2_with_everything_that_is_wrong(attlog, tmp_path: Path) -> None:
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


def test_a_log_that_is_not_there_is_66(attlog, tmp_path: Path) -> None:
    done = attlog("sweep", tmp_path / "none.ulg", "mahony", "kp=1")
    assert (done.code, "none.ulg" in done.err) == (66, True)


def test_a_flight_that_is_given_twice_is_swept_once_and_both_are_named(attlog, tmp_path: Path) -> None:
    again = tmp_path / "again.ulg"
    again.write_bytes(LOG.read_bytes())
    done = attlog("sweep", LOG, again, "mahony", "kp=0.3,0.6", "-o", tmp_path, "--json")
    assert done.code == 0, done.err
    assert f"again.ulg and {LOG.name} are one flight: only {LOG.name} counts" in done.err
    assert [log["name"] for log in json.loads(done.out)["logs"]] == [LOG.name]


def test_the_log_of_a_radio_comes_last_for_of_one_flight_the_card_counts() -> None:
    from attlog.analysis.config import Config
    from attlog.cli.shared.prepared_logs import PreparedLogs

    card, radio = SAMPLES / "copter_steps_stabilize.bin", next(SAMPLES.glob("*.tlog"))
    assert PreparedLogs([radio, card], Config())._logs == [card, radio]
