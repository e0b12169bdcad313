"""What a sweep costs against evaluating its settings one after the other, on one core.

    python benchmarks/sweep.py [LOG ...]

Without LOGs: three of ``sample_logs``.
Both prepare the log once. ``one by one`` is ``attlog.evaluate(case, ["mahony:kp=..."])`` for each setting, which
answers every metric; ``alone`` runs each setting by itself and asks only what the sweep asks; ``sweep`` is the whole
command's work: batches, metrics, comparison with the best, page, JSON, CSV. CPU seconds of this process, kernels
compiled before.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import attlog
from attlog.analysis import replay
from attlog.compare.configurations.configuration import parse
from attlog.compare.sweep import text as sweep_words
from attlog.compare.sweep.grid import grid, text_of
from attlog.compare.sweep.many import SettingsOnLog, wanted
from attlog.compare.sweep.page import sweep_page
from attlog.compare.sweep.sweep import sweep
from attlog.metrics.errors import rmse

SAMPLES = Path(__file__).resolve().parent.parent / "sample_logs"
AXES = ("kp=0.1..2/16", "ki=0..0.05/8")
FEW = 6
FEW_LOGS = ("px4_steps.ulg", "px4_hover.ulg", "copter_yaw_turns.bin")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", metavar="LOG", default=[SAMPLES / name for name in FEW_LOGS])
    paths = parser.parse_args(arguments).logs
    base, asked = parse("mahony"), wanted(["inclination_rmse_deg", "heading_rmse_deg"])
    settings = grid(AXES, base.row.estimator)
    print(f"{len(settings)} settings; ms of CPU for each\n")
    print("| log | one by one | alone | sweep | ratios |\n|---|---|---|---|---|")
    for path in paths:
        case = attlog.prepare(path)
        some = [f"mahony:{text_of(s)}" for s in list(settings)[1 :: len(settings) // FEW]]
        attlog.evaluate(case, some[:1])
        SettingsOnLog(case, base, asked)(list(settings)[:2])
        begin = time.process_time()
        for one in some:
            attlog.evaluate(case, [one])
        each = (time.process_time() - begin) / len(some)
        begin = time.process_time()
        for one in some:
            rmse.compute(case, replay.run_rows(case, [one])[0], "all", only={a.metric for a in asked})
        alone = (time.process_time() - begin) / len(some)
        begin = time.process_time()
        found = sweep("mahony", settings, [SettingsOnLog(case, base, asked)])
        told = {"attlog": {"version": attlog.__version__}, "command": "", "logs": []}
        len(sweep_page(found, told) + str(sweep_words.document(found, told)) + sweep_words.csv_text(found))
        many = (time.process_time() - begin) / len(settings)
        print(
            f"| {Path(path).name} | {1e3 * each:.0f} | {1e3 * alone:.1f} | {1e3 * many:.1f} | "
            f"{each / many:.0f}, {alone / many:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
