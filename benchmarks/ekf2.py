"""How closely EKF2 run again follows what flew: a table over PX4 logs, by version.

``python benchmarks/ekf2.py LOG.ulg ...`` prints a row a log: differences of tilt and heading to ``vehicle_attitude`` in
the air as median / 95 % in deg, the ratio of velocity sigmas, CPU per 100 s.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import attlog
from attlog.core.errors import AttlogError
from attlog.estimators.ekf2.run import rerun
from attlog.pipeline import onboard_rerun as again


def row(path: str) -> str:
    """One line of the table."""
    try:
        case = attlog.prepare(path)
        inputs = again.inputs_of(case, "")
        rate = again.gnss_rate_of(case, "")
        field = again._field(case.log)
        begin = time.process_time()
        found = rerun(inputs, *field, gnss_hz=rate)
        cost = time.process_time() - begin
        estimate = found.estimate(case.log.t0_us * 1e-6)
        same = again.reproduction(case, estimate, found.start)
    except AttlogError as error:
        return f"| {path.rpartition('/')[2]} | {error} | | | | |"
    if same is None:
        return f"| {path.rpartition('/')[2]} | no attitude to compare with | | | | |"
    sigma = ""
    if inputs.states is not None:
        k = np.clip(np.searchsorted(found.t_step, inputs.states.t), 0, len(found.t_step) - 1)
        logged = inputs.states.covariances[:, 4 if found.facts["era"] <= 2 else 3]
        with np.errstate(invalid="ignore", divide="ignore"):
            sigma = f"{np.nanmedian(np.sqrt(found.states['velocity_variance'][k, 0] / logged)):.2f}"
    version, where = ".".join(map(str, inputs.version)), "" if same.airborne else ", ground"
    seconds = float(estimate.t[-1] - estimate.t[0])
    return (
        f"| {path.rpartition('/')[2]} | {version}, {found.start}{where} "
        f"| {same.tilt_median_deg:.2f} / {same.tilt_p95_deg:.2f} "
        f"| {same.heading_median_deg:.2f} / {same.heading_p95_deg:.2f} "
        f"| {sigma} | {100 * cost / seconds:.2f} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", metavar="LOG")
    logs = parser.parse_args().logs
    print("| log | version, start | tilt, deg | heading, deg | sigma of velocity, ours / logged | CPU s per 100 s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for log in logs:
        print(row(log), flush=True)
