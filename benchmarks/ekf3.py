"""How closely EKF3 run again follows what flew: a table over ArduPilot logs, by version.

``python benchmarks/ekf3.py LOG.bin ...`` prints a row a log: differences of tilt and heading to the onboard attitude in
the air as median / 95 % in deg, the ratio of velocity, gyro bias and position variances, CPU per 100 s.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog.core.errors import AttlogError
from attlog.estimators.ekf3.run import rerun
from attlog.estimators.rerun import Rerun
from attlog.pipeline import onboard_rerun as again

# First seconds after a start, which are not compared.
SETTLING_S = 20.0


def variance_ratios(found: Rerun, t: NDArray[np.float64], logged: NDArray[np.float64]) -> str:
    """Return medians of re-run over logged variances: north velocity, north position, x and z gyro bias."""
    k = np.clip(np.searchsorted(found.t_step, t), 0, len(found.t_step) - 1)
    step = found.facts["step_s"]
    known = np.flatnonzero(np.isfinite(found.states["gnss"]))
    use = (t > found.t_step[known[0]] + SETTLING_S) & (t < found.t_step[known[-1]])
    ours = np.column_stack(
        [
            found.states["velocity_variance"][k, 0],
            found.states["position_variance"][k, 0],
            found.states["gyro_bias_variance"][k][:, [0, 2]] * step**2,
        ]
    )
    if not use.any():
        return ""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.nanmedian(ours[use] / logged[use][:, [4, 7, 10, 12]], axis=0)
    return " ".join(f"{ratio:.2f}" for ratio in ratios)


def row(path: str) -> str:
    """One line of the table."""
    name = path.rpartition("/")[2]
    try:
        case = attlog.prepare(path)
        imu = case.log.replay_imu
        inputs = again.inputs_of(case, "" if imu is None else str(imu.index))
        rerun(inputs)  # the first use may compile
        begin = time.process_time()
        found = rerun(inputs)
        cost = time.process_time() - begin
        estimate = found.estimate(case.log.t0_us * 1e-6)
        same = again.reproduction(case, estimate, found.start)
    except AttlogError as error:
        return f"| {name} | {error} | | | | |"
    if same is None:
        return f"| {name} | no attitude to compare with | | | | |"
    states = inputs.states
    ratios = "" if states is None else variance_ratios(found, states.t_variances, states.variances)
    version, where = ".".join(map(str, inputs.version)), "" if same.airborne else ", ground"
    seconds = float(estimate.t[-1] - estimate.t[0])
    return (
        f"| {name} | {version}, {found.start}{where} "
        f"| {same.tilt_median_deg:.2f} / {same.tilt_p95_deg:.2f} "
        f"| {same.heading_median_deg:.2f} / {same.heading_p95_deg:.2f} "
        f"| {ratios} | {100 * cost / seconds:.2f} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", metavar="LOG")
    logs = parser.parse_args().logs
    print("| log | version, start | tilt, deg | heading, deg | variances, ours / logged | CPU s per 100 s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for log in logs:
        print(row(log), flush=True)
