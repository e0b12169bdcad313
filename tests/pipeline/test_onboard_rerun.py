"""EKF2 run again on sample logs: it follows what flew, and a change of a parameter acts as it must."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.core.errors import UsageError
from attlog.metrics.metric import Case
from attlog.pipeline.onboard_rerun import rerun_row
from attlog.pipeline.replay import run_rows
from tests.conftest import SAMPLES

RUN = "px4_ekf2"


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(SAMPLES / "px4_steps.ulg", {"estimators": [RUN]})


def attitude(case: Case, spec: str) -> tuple[np.ndarray, np.ndarray, dict[str, float | str]]:
    """Times, attitudes and quality of a re-run."""
    from attlog.estimators import parse

    imu = next(iter(case.imus.values()))
    row, _ = rerun_row(case, imu, parse(spec), spec)
    return row.t, row.q, row.quality


def heading_apart(a: np.ndarray, b: np.ndarray) -> float:
    from attlog.core import rotation

    return float(np.degrees(np.median(np.abs(rotation.heading_angle(rotation.earth_error(a, b))))))


@pytest.mark.slow
def test_the_filter_that_flew_is_followed_within_a_fifth_of_a_degree(case: Case) -> None:
    _, _, quality = attitude(case, RUN)
    assert quality["follows"] == "yes"
    tilt = float(str(quality["reproduction"]).partition("within ")[2].partition("°")[0])
    assert tilt <= 0.2


@pytest.mark.slow
def test_a_change_of_declination_turns_the_heading_by_it(case: Case) -> None:
    """With the model switched off the heading is that of the declination that is set."""
    _, straight, _ = attitude(case, f"{RUN}:EKF2_DECL_TYPE=0,EKF2_MAG_DECL=0,EKF2_GPS_CTRL=0")
    _, turned, _ = attitude(case, f"{RUN}:EKF2_DECL_TYPE=0,EKF2_MAG_DECL=20,EKF2_GPS_CTRL=0")
    assert heading_apart(straight, turned) == pytest.approx(20.0, abs=2.0)


@pytest.mark.slow
def test_a_parameter_that_is_set_to_what_flew_changes_nothing(case: Case) -> None:
    _, plain, _ = attitude(case, RUN)
    _, same, _ = attitude(case, f"{RUN}:EKF2_MAG_NOISE=0.05")
    assert same == pytest.approx(plain, abs=1e-6)  # the log holds it in single precision


def test_a_log_that_ekf2_did_not_fly_is_refused() -> None:
    with pytest.raises(UsageError, match="PX4 log"):
        run_rows(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), [RUN])


def test_arrays_are_refused() -> None:
    t = np.arange(0, 1, 0.01)
    with pytest.raises(UsageError, match="runs on a PX4 log"):
        attlog.estimate(RUN, t, np.zeros((len(t), 3)), np.zeros((len(t), 3)))


def test_values_outside_the_documented_range_are_refused() -> None:
    from attlog.estimators import parse

    with pytest.raises(UsageError, match="EKF2_MAG_NOISE=7"):
        parse(f"{RUN}:EKF2_MAG_NOISE=7")
    with pytest.raises(UsageError, match="EKF2_MAG_NOISE"):
        parse(f"{RUN}:EKF2_MAGNOISE=0.1")
