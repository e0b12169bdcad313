"""How closely EKF2 and EKF3 run again follow what flew: a table over logs, by version.

``python benchmarks/rerun.py LOG ...`` prints a row a log: differences of tilt and heading to the onboard attitude in
the air as median / 95 % in deg, medians of re-run over logged variances (of north velocity; of EKF3 also north
position, x and z gyro bias), CPU per 100 s.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog.core.errors import AttlogError
from attlog.estimators.rerun import Rerun
from attlog.pipeline.onboard_rerun import flown_filter, inputs_of, reproduction, run_again

Array = NDArray[np.float64]
# First seconds after a start, which are not compared.
SETTLING_S = 20.0


def variance_ratios(found: Rerun, inputs: Any) -> str:
    """Return medians of re-run over logged variances, empty without logged ones."""
    if inputs.states is None:
        return ""
    if "era" in found.facts:
        t = inputs.states.t
        logged = inputs.states.covariances[:, [4 if found.facts["era"] <= 2 else 3]]
    else:
        t, logged = inputs.states.t_variances, inputs.states.variances[:, [4, 7, 10, 12]]
    k = np.clip(np.searchsorted(found.t_step, t), 0, len(found.t_step) - 1)
    ours = found.states["velocity_variance"][k, :1]
    if "step_s" in found.facts:
        position, bias = found.states["position_variance"][k, :1], found.states["gyro_bias_variance"][k][:, [0, 2]]
        ours = np.hstack([ours, position, bias * found.facts["step_s"] ** 2])
    known = found.t_step[np.isfinite(found.states["gnss"])]
    use = (t > known[0] + SETTLING_S) & (t < known[-1])
    if not use.any():
        return ""
    with np.errstate(invalid="ignore", divide="ignore"):
        return " ".join(f"{ratio:.2f}" for ratio in np.nanmedian(ours[use] / logged[use], axis=0))


def row(path: str) -> str:
    """Return a log's line of the table."""
    name = path.rpartition("/")[2]
    try:
        case = attlog.prepare(path)
        flown, imu = flown_filter(case.log), case.log.replay_imu
        if not flown or imu is None:
            return f"| {name} | no filter flew that is run again | | | | |"
        run_again(case, imu, flown, {})  # the first use may compile
        begin = time.process_time()
        found = run_again(case, imu, flown, {})
        cost = time.process_time() - begin
        estimate = found.estimate(case.log.t0_us * 1e-6)
        same = reproduction(case, estimate, found.start)
        inputs = inputs_of(case, str(imu.index) if flown == "ap_ekf3" else "")
    except AttlogError as error:
        return f"| {name} | {error} | | | | |"
    if same is None:
        return f"| {name} | no attitude to compare with | | | | |"
    version, where = ".".join(map(str, inputs.version)), "" if same.airborne else ", ground"
    return (
        f"| {name} | {version}, {found.start}{where} "
        f"| {same.tilt_median_deg:.2f} / {same.tilt_p95_deg:.2f} "
        f"| {same.heading_median_deg:.2f} / {same.heading_p95_deg:.2f} "
        f"| {variance_ratios(found, inputs)} | {100 * cost / float(estimate.t[-1] - estimate.t[0]):.2f} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", metavar="LOG")
    logs = parser.parse_args().logs
    print("| log | version, start | tilt, deg | heading, deg | variances, ours / logged | CPU s per 100 s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for log in logs:
        print(row(log), flush=True)
