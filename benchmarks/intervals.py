"""How often is what the report says about real flights true? Asked of simulated flights whose truth is taken away.

    python benchmarks/intervals.py [--corpus DIR] [--flights GLOB] [--quick] [--real] [--misses] [--keep DIR]

Every flight below ``sitl/`` of the corpus folder (default $ATTLOG_CORPUS) is analysed twice: as a real
log, without its truth, and with it. One line per column and window, over all replayed default filters:

- ``answered``: share of the rows with a value, without truth and with it;
- ``holds``: how often the interval that stands there without truth holds what truth says. Noise: the typical
  window of estimate minus truth. Lag and gain: the same filter on a gyro made from the truth. Others: the value
  against truth. ``*``: without truth such a value is agreement with the autopilot and does not claim to be an error;
- ``halves``: how often the first half's interval meets the second half of the same flight, which is independent of
  it: difference within the root sum of squares of both widths. Noise of the second half is that of truth;
- ``told``: pairs of rows told apart without truth, and how many of them truth has the other way round;
- ``first half``: the same of pairs that the first half tells, in the truth of the second.

A good interval holds 90 to 99 %; at most 5 % of told pairs may be wrong. Last come the columns outside (``holds``
may be 100 %: truth stands in the same windows as the value and shares their luck). ``--real``
prints per real log (``logs/``, ``logs/cases/``) which questions have an answer, ``--misses`` each single failure.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog import flight, metrics, pipeline, reference
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.metrics import Answer, Case, correction_noise, following, noise, ranking
from attlog.metrics import noise as metrics_variances
from attlog.metrics.statistics import Summary, make_ids
from attlog.metrics.windows import PHASES
from attlog.pipeline import replay
from attlog.reference.model import Track

Array = NDArray[np.float64]
Table = dict[str, dict[str, dict[str, Answer]]]
"""row -> window -> metric -> Answer"""

DEFINED = metrics.definitions()
MADE = ("lag_ms", "lag_roll_ms", "lag_pitch_ms", "lag_yaw_ms", "step_gain")
"""Known where the gyro is made from the truth: what such a filter shows is its own."""
AGREEMENT = ("total_", "heading_", "tilt_", "drift_air_", "distortion_")
ERRORS = ("total_", "heading_", "tilt_")
QUICK = ("px4_hover.ulg", "px4_steps.ulg", "copter_aggressive.bin", "copter_hover_rest.bin")
HELD, WRONG, LEAST = (90.0, 99.0), 5.0, 20
"""What is asked for; columns with fewer cases than the last are not judged."""
LEAST_TRUE = 10
"""Samples of truth that a window of noise needs."""


@dataclass
class Flight:
    """What one flight showed: counts by column and what is counted; misses in words."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    misses: list[str] = field(default_factory=list)

    def count(self, column: str, what: str, good: bool | None = None, why: str = "") -> None:
        """One case of ``what``; where ``good`` is told, also whether it was (else a miss with its reason)."""
        own = self.counts.setdefault(column, Counter())
        own[what] += 1
        if good is not None:
            own[f"{what} good"] += good
            if not good:
                self.misses.append(f"{column}: {what}: {why}")

    def add(self, other: Flight) -> None:
        """The counts of another flight as well."""
        for column, counts in other.counts.items():
            self.counts.setdefault(column, Counter()).update(counts)


@dataclass
class Side:
    """A flight seen with or without truth: the case, its replayed rows and all answers."""

    case: Case
    rows: dict[str, Track]
    table: Table

    @property
    def comparable(self) -> list[str]:
        """Rows that may be ranked."""
        return [name for name, row in self.rows.items() if ranking.may_be_best(row)]


def side(path: Path, truth: bool, halves: tuple[str, ...] = ()) -> Side:
    """One flight, analysed; ``halves`` are windows ``T0:T1`` to answer for as well."""
    log = flight.read(path)
    case = pipeline.prepare(log if truth else replace(log, truth=None))
    rows = {row.name: row for row in replay.run_rows(case, ["default"])}
    case = case.with_rows([*rows.values(), *reference.onboard_rows(case.log, case.segments, case.reference)])
    windows = (*case.windows, *(halves or halves_of(case)))
    return Side(case, rows, {n: metrics.compute(case, row, windows) for n, row in rows.items()})


def halves_of(case: Case) -> tuple[str, ...]:
    """Four windows: first and second half of the scored flight, and of the longest rest."""
    found = []
    for spans in (case.segments.spans("airborne"), sorted(case.segments.spans("rest"), key=lambda s: s[1] - s[0])[-1:]):
        scored = [(max(t0, case.reference.scoring.start), t1) for t0, t1 in spans if t1 > case.reference.scoring.start]
        if scored:
            t0, t1 = scored[0][0], scored[-1][1]
            found += [f"{t0:.3f}:{(t0 + t1) / 2:.3f}", f"{(t0 + t1) / 2:.3f}:{t1:.3f}"]
        else:
            found += ["", ""]
    return tuple(w for w in found if w) if all(found) else (found[0], found[1]) if found[0] else ()


def made(truth: Side) -> dict[str, dict[str, Answer]]:
    """Answers about movements of the same filters on a gyro made from the truth: row -> metric -> Answer."""
    case = truth.case
    unit, seen = case.imus[""], case.reference
    t = unit.gyro.t_best
    q = rotation.slerp(seen.t, seen.q, np.clip(t, seen.t[0], seen.t[-1]))
    turned = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    rate = np.vstack([np.zeros(3), turned / np.diff(t)[:, None]])
    gyro = replace(unit.gyro, x=rate, sampling="interval")
    found = {}
    for row in replay.run_rows(replace(case, imus={"": replace(unit, gyro=gyro, dt=None)}), ["default"]):
        row.status, row.imu = "ok", unit
        found[row.name] = metrics.compute(case, row, ("all",))["all"]
    return found


def true_noise(row: Track, phase: str, starts: Array) -> tuple[Array, Array]:
    """Which windows (k,) truth covers, and the variances (m, 4) of estimate minus truth in these, as noise has them."""
    covered, variances = np.zeros(len(starts), bool), []
    errors = row.errors
    if errors is None:
        return covered, np.zeros((0, 4))
    for k, start in enumerate(starts):
        i, j = np.searchsorted(errors.t, [start, start + 5.0])
        if j - i < LEAST_TRUE or not errors.scored[i:j].all():
            continue
        moving = correction_noise.GyroAttitude(errors.t, errors.q_ref, errors.gap_segment)
        left = correction_noise.residual(errors.t[i:j], errors.q_est[i:j], moving, 180.0)
        if left is not None:
            covered[k] = True
            variances.append(metrics_variances.variance(left))
    return covered, np.array(variances).reshape(-1, 4)


def columns() -> Iterator[tuple[str, str]]:
    """Metrics that have a value with an interval, each with the windows that it is asked in."""
    for name in DEFINED:
        if name.startswith("noise_"):
            yield from ((name, phase) for phase in PHASES)
        elif name.startswith("hover_"):
            yield name, "hover"
        elif name.startswith(("total_", "heading_", "tilt_", "drift_air_")):
            yield name, "airborne"
        else:
            yield name, "all"


def meets(a: Summary, b: Summary) -> bool:
    """Whether two independent values agree within both intervals."""
    if a.ci95 is None or b.ci95 is None:
        return False
    low, high = sorted((a, b), key=lambda s: s.value)
    assert low.ci95 is not None
    assert high.ci95 is not None
    return high.value - low.value <= math.hypot(low.ci95[1] - low.value, high.value - high.ci95[0])


def size(value: float, metric: str) -> float:
    """How far a value is from perfect."""
    return {"low": value, "zero": abs(value), "one": abs(value - 1.0), "high": -value}[DEFINED[metric].better]


def text(metric: str, row: str, a: Answer, true: float) -> str:
    """A miss in words."""
    interval = "" if a.ci95 is None else f" [{a.ci95[0]:.4g}, {a.ci95[1]:.4g}]"
    return f"{row} {a.value:.4g}{interval} n {a.n}, truth {true:.4g}"


def told(answers: dict[str, Answer], metric: str) -> list[tuple[str, str]]:
    """Pairs (better, worse) that the ranking tells apart; the answers keep their values."""
    copies = {name: replace(a) for name, a in answers.items()}
    return ranking.family(copies, DEFINED[metric].better).significant


def judge_pairs(
    seen: Flight, column: str, what: str, metric: str, pairs: list[tuple[str, str]], true: dict[str, float]
) -> None:
    """Count told pairs whose truth is known, and those that truth has the other way round."""
    for better, worse in pairs:
        if better in true and worse in true:
            a, b = true[better], true[worse]
            good = size(a, metric) <= size(b, metric)
            seen.count(column, what, good, f"{better} told better than {worse}, truth {a:.4g} {b:.4g}")


def judge_noise(seen: Flight, blind: Side, truth: Side, metric: str, phase: str) -> None:
    """Noise of a phase: every interval against estimate minus truth, and halves, in the same windows."""
    column, axis = f"{metric} {phase}", metrics_variances.NOISE_AXES.index(metric.split("_")[1])
    first: dict[str, Answer] = {}
    same: dict[str, float] = {}
    later: dict[str, float] = {}
    for name, row in blind.rows.items():
        answer = blind.table[name][phase].get(metric)
        if answer is None or answer.value is None or answer.units is None or not answer.ranked:
            continue
        found = metrics_variances.phase_variances(blind.case, row, phase, phase)
        assert found is not None
        covered, v = true_noise(truth.rows[name], phase, found.t0)
        if not covered.any():
            continue
        ids, logs = make_ids(found.t0)[covered], np.log(np.maximum(v[:, axis], 1e-18))
        prior = noise.prior_of(row, phase, metrics_variances.NOISE_AXES[axis])
        real = noise.typical(ids, logs, prior, 0.0, ids)
        own = answer.units.on(ids)
        same[name] = real.value
        if own.ci95 is not None:
            seen.count(
                column, "holds", own.ci95[0] <= real.value <= own.ci95[1], text(metric, name, answer, real.value)
            )
        if len(ids) >= 2:
            cut = ids[len(ids) // 2]
            early, rest = ids[ids < cut], ids[ids >= cut]
            mine, its = answer.units.on(early), noise.typical(ids, logs, prior, 0.0, rest)
            seen.count(column, "halves", meets(mine, its), f"{name} {mine} then {its}")
            inside = np.isin(answer.units.ids, early)
            units = replace(answer.units, ids=answer.units.ids[inside], values=answer.units.values[inside])
            first[name], later[name] = replace(answer, value=mine.value, ci95=mine.ci95, units=units), its.value
    answers = {n: blind.table[n][phase][metric] for n in same if n in blind.comparable}
    judge_pairs(seen, column, "told", metric, told(answers, metric), same)
    judge_pairs(
        seen, column, "first", metric, told({n: a for n, a in first.items() if n in blind.comparable}, metric), later
    )


def judge(seen: Flight, blind: Side, truth: Side, own: dict[str, dict[str, Answer]], metric: str, window: str) -> None:
    """Any other column: every interval against the value of truth, the halves, and the pairs."""
    column = f"{metric} {window}" + ("*" if metric.startswith(AGREEMENT) else "")
    said = metric if not metric.startswith("drift_air_") else "drift_air_deg_per_min.truth"
    true: dict[str, float] = {}
    for name in blind.rows:
        answer, known = blind.table[name][window].get(metric), truth.table[name][window].get(said)
        if metric.startswith(MADE):
            known = own.get(name, {}).get(metric)
            value = None if known is None or known.value is None else known.value + (known.taken_out or 0.0)
        else:
            value = None if known is None else known.value
        if value is None:
            continue
        true[name] = value
        for what, a in (("holds", answer), ("with truth", truth.table[name][window].get(metric))):
            if (
                a is not None
                and a.value is not None
                and a.ci95 is not None
                and (what == "holds" or metric.startswith(MADE))
            ):
                seen.count(column, what, a.ci95[0] <= value <= a.ci95[1], text(metric, name, a, value))
    if not DEFINED[metric].decided_by:
        judge_pairs(seen, column, "told", metric, told(of(blind, window, metric), metric), true)


def of(side: Side, window: str, metric: str) -> dict[str, Answer]:
    """The answers of the rows that may be ranked."""
    table = {n: side.table[n].get(window, {}).get(metric) for n in side.comparable}
    return {n: a for n, a in table.items() if a is not None}


def judge_halves(seen: Flight, blind: Side, truth: Side, metric: str, window: str, halves: tuple[str, str]) -> None:
    """The first half without truth against the second half; where only truth answers, both with it."""
    early, late = halves
    said = metric if not metric.startswith("drift_air_") else "drift_air_deg_per_min.truth"
    for here, column in (
        (blind, f"{metric} {window}" + ("*" if metric.startswith(AGREEMENT) else "")),
        (truth, f"{metric} {window} +truth"),
    ):
        if here is truth and (metric != said or not metric.startswith((*AGREEMENT, "lag", "step_"))):
            continue
        true = {}
        for name, row in here.rows.items():
            if metric.startswith(ERRORS) and following.why_uncorrected(here.case, row):
                continue  # its error grows with the flight: one half says nothing of the other
            a, b = (here.table[name].get(w, {}).get(metric) for w in halves)
            if a is not None and b is not None and a.value is not None and b.value is not None and a.ci95 and b.ci95:
                good = meets(Summary(a.value, a.ci95), Summary(b.value, b.ci95))
                seen.count(column, "halves", good, f"{text(metric, name, a, b.value)}, its {b.ci95}")
            known = truth.table[name].get(late, {}).get(said)
            if known is not None and known.value is not None:
                true[name] = known.value
        if not DEFINED[metric].decided_by:
            judge_pairs(seen, column, "first", metric, told(of(here, early, metric), metric), true)


def observe(path: Path) -> Flight | None:
    """Everything counted on one flight; None where the log holds no truth."""
    truth = side(path, True)
    if truth.case.reference.kind != "truth":
        return None
    halves = halves_of(truth.case)
    blind, own, seen = side(path, False, halves), made(truth), Flight()
    for metric, window in columns():
        for name in blind.rows:
            a, b = (s.table[name].get(window, {}).get(metric) for s in (blind, truth))
            if a is not None or b is not None:
                column = f"{metric} {window}" + ("*" if metric.startswith(AGREEMENT) else "")
                seen.count(column, "rows")
                seen.counts[column]["blind"] += a is not None and a.value is not None
                seen.counts[column]["true"] += b is not None and b.value is not None
        if metric.startswith("noise_"):
            judge_noise(seen, blind, truth, metric, window)
            continue
        judge(seen, blind, truth, own, metric, window)
        at_rest = metric.startswith("drift_rest")
        if at_rest and len(halves) == 4:
            judge_halves(seen, blind, truth, metric, window, (halves[2], halves[3]))
        elif not at_rest and halves:
            judge_halves(seen, blind, truth, metric, window, (halves[0], halves[1]))
    return seen


def kept(folder: Path | None, path: Path, compute: Callable[[Path], Flight | None]) -> Flight | None:
    """The flight from ``folder`` where it was seen before, else computed and kept there."""
    file = None if folder is None else folder / f"{path.name}.json"
    if file is not None and file.exists():
        found = json.loads(file.read_text())
        return None if found is None else Flight({k: Counter(v) for k, v in found["counts"].items()}, found["misses"])
    seen = compute(path)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(None if seen is None else {"counts": seen.counts, "misses": seen.misses}))
    return seen


def share(own: Counter[str], what: str, of: str | None = None) -> str:
    """A share in percent with its count, or nothing."""
    n = own[of or what]
    return f"{100 * own[what if of else what + ' good'] / n:4.0f} % of {n:<4d}" if n else " " * 14


def wrong(own: Counter[str], what: str) -> str:
    """Wrong pairs of told pairs."""
    return f"{own[what] - own[what + ' good']:3d} of {own[what]:<4d}" if own[what] else " " * 11


def show(total: Flight) -> None:
    """The table, then the columns that are outside of what is asked for."""
    head = ("column", "answered", "with truth", "holds", "holds, truth", "halves", "told wrong", "first half")
    print("{:44}{:>14}{:>14}{:>15}{:>15}{:>15}{:>12}{:>12}".format(*head))
    outside = []
    for column, own in total.counts.items():
        if not own["holds"] + own["halves"] + own["told"] + own["first"]:
            continue
        print(
            f"{column:44}{share(own, 'blind', 'rows'):>14}{share(own, 'true', 'rows'):>14}{share(own, 'holds'):>15}"
            f"{share(own, 'with truth'):>15}{share(own, 'halves'):>15}{wrong(own, 'told'):>12}{wrong(own, 'first'):>12}"
        )
        for what in ("holds", "with truth", "halves"):
            percent = 100 * own[what + " good"] / own[what] if own[what] >= LEAST else HELD[0]
            most = HELD[1] if what != "holds" else 100.0
            if not HELD[0] <= percent <= most and not (what == "holds" and column.endswith("*")):
                outside.append(f"{column}: {what} {percent:.0f} % of {own[what]}")
        for what in ("told", "first"):
            bad = own[what] - own[what + " good"]
            if own[what] >= LEAST and 100 * bad > WRONG * own[what]:
                outside.append(f"{column}: {what} {bad} of {own[what]} wrong")
    print("\noutside of 90 to 99 % held, or more than 5 % of told pairs wrong:")
    print("\n".join(f"  {line}" for line in outside) or "  none")


QUESTIONS = {
    "accuracy": ("tilt_rmse_deg",),
    "noise": ("noise_tilt_deg",),
    "lag": ("lag_ms",),
    "yaw_drift": ("drift_rest_deg_per_min", "drift_air_deg_per_min."),
}


def answered(path: Path) -> tuple[float, dict[str, bool]] | None:
    """Seconds in the air of a real log, and which questions it answers for a filter that gravity corrects."""
    try:
        case = pipeline.prepare(path)
    except AttlogError:
        return None
    table = pipeline.evaluate(case).estimators
    air = sum(t1 - t0 for t0, t1 in case.segments.spans("airborne"))
    values = [
        name
        for row in table
        if row.kind == "replay" and row.name != "gyro"
        for answers in row.metrics.values()
        for name, a in answers.items()
        if a.value is not None and (a.ranked or not name.startswith("noise_"))
    ]
    return air, {q: any(v.startswith(ids) for v in values) for q, ids in QUESTIONS.items()}


def show_real(paths: list[Path]) -> None:
    """Per real log which questions are answered; then the shares where it flew for 20 s."""
    print(f"\n{'real log':56}{'air s':>8}" + "".join(f"{q:>10}" for q in QUESTIONS))
    flown: list[dict[str, bool]] = []
    for path in paths:
        found = answered(path)
        if found is None:
            print(f"{path.name:56}  cannot be analysed")
            continue
        print(f"{path.name:56}{found[0]:8.0f}" + "".join(f"{'yes' if v else '-':>10}" for v in found[1].values()))
        if found[0] >= 20.0:
            flown.append(found[1])
    line = "".join(f"{sum(f[q] for f in flown):>10}" for q in QUESTIONS)
    print(f"{f'of {len(flown)} that flew for 20 s':64}{line}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"), help="folder with the data")
    parser.add_argument("--flights", default="*", help="names of the flights, as a pattern")
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}")
    parser.add_argument("--real", action="store_true", help="also which questions the real logs answer")
    parser.add_argument("--misses", action="store_true", help="also every single miss")
    parser.add_argument("--keep", type=Path, help="folder in which what was counted per flight is kept and found again")
    given = parser.parse_args()
    if given.corpus is None:
        print("intervals.py: skipped, needs the flights with truth (sitl/ below --corpus or ATTLOG_CORPUS)")
        return
    total = Flight()
    for path in sorted((Path(given.corpus) / "sitl").glob("*/*")):
        chosen = path.name in QUICK if given.quick else path.suffix in (".ulg", ".bin", ".tlog")
        if not chosen or not fnmatch.fnmatch(path.name, given.flights):
            continue
        seen = kept(given.keep, path, observe)
        if seen is None:
            print(f"{path.name}: skipped, no truth in it")
            continue
        total.add(seen)
        if given.misses:
            print("\n".join(f"{path.name}: {miss}" for miss in seen.misses))
    show(total)
    if given.real:
        folders = (Path(given.corpus) / "logs", Path(given.corpus) / "logs" / "cases")
        logs = [p for f in folders for p in sorted(f.glob("*")) if p.is_file() and p.suffix not in (".csv", ".md")]
        show_real([p for p in logs if fnmatch.fnmatch(p.name, given.flights)])


if __name__ == "__main__":
    main()
