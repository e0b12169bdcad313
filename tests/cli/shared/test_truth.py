"""``--truth``: what a user brings is the reference in every command that compares; what is wrong with it is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight import read
from tests.conftest import SAMPLES

LOG = SAMPLES / "px4_steps.ulg"
LATE_S = 1234.5
BODY, WORLD = rotation.from_euler(0.1, -0.2, 2.0), rotation.from_euler(np.pi, 0.0, 1.0)


@pytest.fixture(scope="module")
def mocap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulator's truth as a laboratory would have measured it: another clock, other axes, a little noise."""
    truth = read(LOG).truth
    assert truth is not None
    t = truth.t if truth.t_sample is None else truth.t_sample
    noise = rotation.from_rotvec(np.radians(0.05) * np.random.default_rng(0).normal(size=(len(t), 3)))
    q = rotation.multiply(WORLD, rotation.multiply(rotation.multiply(truth.q, noise), BODY))
    path = tmp_path_factory.mktemp("truths") / "px4_steps.tum"
    rows = np.column_stack([t + LATE_S, np.zeros((len(t), 3)), q[:, 1:], q[:, :1]])
    path.write_text("\n".join(" ".join(f"{x:.9f}" for x in row) for row in rows))
    return path


@pytest.mark.slow
def test_analyze_compares_with_it_and_tells_how_it_was_aligned(attlog: Any, mocap: Path, tmp_path: Path) -> None:
    rows = ("--estimators", "mahony,mekf")
    done = attlog("analyze", str(LOG), "--truth", str(mocap), *rows, "-o", str(tmp_path))
    assert done.code == 0
    assert "Against your truth" in done.out
    found = json.loads((tmp_path / "px4_steps.ulg.json").read_text())["reference"]
    assert (found["choice"], found["source"], found["heading_by"]) == ("truth", "px4_steps.tum", "relative")
    assert found["fit"]["offset_s"] == pytest.approx(-LATE_S, abs=0.005)
    assert found["fit"]["body_deg"] == pytest.approx(np.degrees(rotation.to_euler(BODY)), abs=0.5)
    assert 0.0 < found["sigma_tilt_deg"] < 2.0
    page = (tmp_path / "px4_steps.ulg.html").read_text()
    assert "compared with your truth (px4_steps.tum)" in page


@pytest.mark.slow
@pytest.mark.parametrize("words", [("compare", "mahony", "mekf"), ("sweep", "mahony", "kp=0.3,0.6")])
def test_the_commands_that_compare_take_one_too_also_of_a_folder(
    attlog: Any, mocap: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    command, *rest = words
    done = attlog(command, str(LOG), *rest, "--truth", str(mocap.parent), "-o", str(tmp_path))
    assert done.code == 0, done.err
    made = json.loads(next(tmp_path.glob("*.json")).read_text())
    assert made["logs"][0]["reference"].startswith("truth")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--truth", "nowhere.tum"), 66, "nowhere.tum: no such file"),
        (("--truth", "vehicle_mocap_odometry"), 2, "it holds vehicle_attitude"),
        (("--truth", "gnss_yaw"), 2, "no receiver of px4_steps.ulg tells a heading of two antennas"),
        (("--truth", "vehicle_attitude:ofset=3"), 2, "did you mean offset=?"),
        (("--truth", "vehicle_attitude", "--reference", "onboard"), 2, "leave out one of the two"),
    ],
)
def test_what_is_wrong_with_it_is_said(
    attlog: Any, tmp_path: Path, words: tuple[str, ...], code: int, said: str
) -> None:
    done = attlog("analyze", str(LOG), *words, "-o", str(tmp_path))
    assert done.code == code
    assert said in done.err
    assert not list(tmp_path.iterdir())


def test_of_a_folder_the_file_with_the_log_s_name_is_taken(attlog: Any, tmp_path: Path) -> None:
    (tmp_path / "other.tum").write_text("1 0 0 0 0 0 0 1\n")
    done = attlog("analyze", str(LOG), "--truth", str(tmp_path), "-o", str(tmp_path / "out"))
    assert done.code == 2
    assert "none named px4_steps.*" in done.err
