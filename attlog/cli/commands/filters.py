"""Commands about filters: list them (``estimators``), write one (``new``), check one (``check-estimator``)."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli import options
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, terminal, to_stdout
from attlog.estimators.accuracy import NOT_MEASURED, SETS, MeanRmse, read_accuracy

if TYPE_CHECKING:
    from attlog.estimators import Estimator
    from attlog.testing import CheckOutcome


# Sets with a column; the others are in JSON and in the description of one filter.
SHOWN = ("broad", "euroc", "simulated")
SENSORS = ("gyro", "acc", "mag")
NEEDED = (*SENSORS, "gnss")


def accuracy_lines(name: str) -> list[str]:
    """Return the measured errors of a filter and its presets, a line for each set."""
    found = {row: sets for row, sets in read_accuracy().items() if row.partition("@")[0] == name}
    lines = []
    for row, sets in found.items():
        for key, one in sets.items():
            angles = ", ".join(f"{angle} {_interval(rmse)}" for angle, rmse in one.rmse_deg.items())
            lines.append(f"  {row}, {SETS[key]}, {one.trials} trials: {angles}; {one.ns:.0f} ns")
    return lines or [f"  {NOT_MEASURED}"]


def accuracy_table(estimators: Sequence[Estimator]) -> Iterator[TextLine]:
    """Yield a table of needs, mean errors on the sets and cost, with its legend."""
    known = read_accuracy()
    rows = []
    for e in estimators:
        sets = known.get(e.name, {})
        cells = [sets[key].short() if key in sets else "-" for key in SHOWN] if sets else [NOT_MEASURED, "", ""]
        cost = next((f"{one.ns:.0f}" for one in sets.values()), "")
        rows.append([e.name, *cells, cost, _short_needs(e)])
    head = ["filter", *(f"{SETS[key]} °" for key in SHOWN), "ns", "needs (uses)"]
    yield from table(rows, head, left=(0, -1), indent="  ")
    every = [sets for name, sets in known.items() if "@" not in name]
    trials = ", ".join(str(max((s[key].trials for s in every if key in s), default=0)) for key in SHOWN)
    dated = sorted({(one.date, one.version) for sets in every for one in sets.values()})
    when = " to ".join(f"{version} ({day})" for day, version in dict.fromkeys([*dated[:1], *dated[-1:]]))
    yield TextLine(f"  Mean RMSE of {trials} trials: total/heading/tilt; EuRoC: tilt.")
    yield TextLine(
        "  -: needs mag or gnss. aids: GNSS, barometer, airspeed, rest: of simulated flights. ns: per update."
    )
    yield TextLine(f"  Measured with attlog {when}.")
    yield TextLine("  Intervals: --json, or attlog estimators NAME.")


def _short_needs(e: Estimator) -> str:
    """Return the sensors that a filter needs, and in brackets those that it uses; aids count as one."""
    more = [s for s in SENSORS if s in e.uses - e.needs] + ["aids"] * bool(e.uses - e.needs - set(SENSORS))
    return " ".join(s for s in NEEDED if s in e.needs) + (f" ({' '.join(more)})" if more else "")


def _interval(rmse: MeanRmse) -> str:
    between = "" if rmse.low is None or rmse.high is None else f" ({rmse.low:.3g} to {rmse.high:.3g})"
    return f"{rmse.value:.3g}{between}"


FilterToShow = Annotated[
    str | None,
    typer.Argument(
        metavar="[NAME|FILE.py]",
        autocompletion=options.complete_filters,
        help="Print all about this filter. [default: list all]",
    ),
]


def estimators_command(
    name: FilterToShow = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON on standard output, one line for each filter.")
    ] = False,
) -> None:
    """List the filters, or show one with its equations.

    The list says what each needs, its errors on public data and its cost.

    Example: attlog estimators mahony
    """
    from attlog.estimators import get, names

    if json:
        for one in names() if name is None else [name]:
            json_to_stdout(filter_document(one, strict=name is not None))
    elif name is None:
        out = console()
        say(filter_list(out.width), out)
    else:
        to_stdout(describe_filter(get(name)))


def describe_filter(estimator: Estimator) -> str:
    """Describe one estimator as plain text: title, equations, sensors, parameters, presets."""
    optional = estimator.uses - estimator.needs
    lines = [f"{estimator.name}: {estimator.title}", "", estimator.text.rstrip(), ""]
    lines.append(f"Source: {estimator.source}")
    lines.append(f"Needs: {_sensors(estimator.needs)}" + (f"; uses {_sensors(optional)} if there" if optional else ""))
    if not estimator.causal:
        lines.append("Looks ahead: its attitude at a time uses samples from later, which no autopilot can.")
    lines += ["", "Parameters"]
    for p in estimator.parameters:
        kind = " | ".join(p.choices) if p.choices else f"{p.low:g} to {p.high:g} {p.unit}".rstrip()
        default = p.default if p.choices else f"{p.default:g}"
        lines += [f"  {p.name} = {default}   ({kind})", f"      {p.meaning}", f"      default from: {p.source}"]
    if estimator.presets:
        lines += ["", "Presets"]
        for preset, values in estimator.presets.items():
            pairs = ", ".join(f"{k} {v:g}" if isinstance(v, float | int) else f"{k} {v}" for k, v in values.items())
            lines.append(f"  {estimator.name}@{preset}: {pairs}")
    lines += ["", "Accuracy: RMSE in deg, mean over trials (95 %)", *accuracy_lines(estimator.name)]
    return "\n".join(lines)


def filter_document(name: str, strict: bool = False) -> dict[str, Any]:
    """Describe one filter as JSON; ``accuracy`` is null if not measured.

    A filter that cannot be loaded has its ``error``, or raises it if ``strict``.
    """
    from attlog.core.errors import AttlogError
    from attlog.estimators import get
    from attlog.estimators.accuracy import read_accuracy

    try:
        e = get(name)
    except AttlogError as error:
        if strict:
            raise
        return {"name": name, "error": str(error)}
    sets = {key: asdict(one) for key, one in read_accuracy().get(e.name, {}).items()}
    return {
        "name": e.name,
        "title": e.title,
        "source": e.source,
        "needs": sorted(e.needs),
        "uses": sorted(e.uses - e.needs),
        "presets": list(e.presets),
        "causal": e.causal,
        "accuracy": sets or None,
    }


def filter_list(width: int) -> Iterator[TextLine]:
    """List estimators with source and presets, or why one cannot be loaded; then needs, errors and cost."""
    from attlog.core.errors import AttlogError
    from attlog.estimators import DEFAULT, get, names

    rows: list[tuple[str, str]] = []
    found: list[Estimator] = []
    for name in names():
        try:
            e = get(name)
        except AttlogError as error:
            rows.append((name, str(error)))
            continue
        found.append(e)
        rows += [(name, e.title), ("", f"source: {e.source}")]
        rows += [("", f"presets: {', '.join(f'{name}@{p}' for p in e.presets)}")] if e.presets else []
    yield from table(rows, left=(0, -1), width=width, styles=["bold" if name else "" for name, _ in rows])
    yield TextLine("")
    yield from accuracy_table(found)
    yield TextLine("")
    yield TextLine(f"default: {', '.join(DEFAULT)}")
    yield TextLine(
        "attlog estimators NAME prints parameters and equations; attlog new FILE.py starts a filter of your own."
    )


def _sensors(sensors: frozenset[str]) -> str:
    known = ("gyro", "acc", "mag")
    return ", ".join([*(s for s in known if s in sensors), *sorted(sensors - set(known))])


FAILED = 1
FilterToCheck = Annotated[
    str,
    typer.Argument(
        metavar="NAME|FILE.py",
        autocompletion=options.complete_filters,
        help="Check this filter; @PRESET and :k=v may follow.",
    ),
]


def check_estimator_command(name: FilterToCheck) -> None:
    """Check that a filter keeps the contract.

    The exit code is 1 if a check fails.

    Example: attlog check-estimator my_filter.py
    """
    from attlog.estimators import parse
    from attlog.testing import about, check_estimator, speed_ns
    from attlog.words.text import for_terminal

    out = terminal()
    subject = parse(name)
    for line in about(subject):
        out.print(f"note  {line}", markup=False, soft_wrap=True)

    def show(outcome: CheckOutcome) -> None:
        mark = "[green]pass[/]" if outcome.passed else "[red]FAIL[/]"
        out.print(f"{mark}  {outcome.name.replace('_', ' ').replace('[', ' in ').replace(']', '')}", soft_wrap=True)
        if not outcome.passed:
            out.print(f"      {for_terminal(outcome.message)}", style="dim", markup=False, soft_wrap=True)

    outcomes = check_estimator(subject, show)
    failed = sum(not o.passed for o in outcomes)
    if failed:
        from attlog.words.numbers import counted

        out.print(f"\n{name}: {failed} of {counted(len(outcomes), 'check')} failed.", markup=False)
        raise typer.Exit(FAILED)
    out.print(f"\n{name}: all {len(outcomes)} checks passed; {speed_ns(subject):.0f} ns per update.", markup=False)


TEMPLATE = '''"""My filter: one line that says what it is.

Equations, for people:

    e   = v x d                     v = -f/g measured down, d predicted down (body axes)
    q'  = q (x) (0, w - b + kp e)/2, b' = -ki e

Frames: body is forward-right-down, earth north-east-down. q turns body vectors into
earth vectors, scalar first. gyr [rad/s], acc [m/s^2] is specific force (at rest
(0, 0, -9.8) when level), mag in any unit.

The loop around it owns time: it skips and counts NaN, gaps, saturation and times that do
not rise, propagates slow magnetometer samples between updates, and starts at q0. A zero
vector in acc or mag means "no sample now". acc and mag belong to the time of the attitude that
step is given; a filter that turns it first and compares then says VECTORS_AT = "end".

USES may also name gnss, baro, airspeed and at_rest: step then takes one argument more, aid
(attlog.estimators.aids says what is in it).
"""

import numpy as np

from attlog.estimators import Parameter
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "where the equations come from"
NEEDS = {"gyro", "acc"}  # cannot run without
USES = {"mag"}  # takes it when there

# Sizes by name, in the order of the state array. "bias" [rad/s] is shown and used between
# magnetometer samples; any other name becomes an output, one that begins with _ does not.
STATE = {"q": 4, "bias": 3}

PARAMETERS = (
    # name, default, unit, lowest, highest, meaning, where the default comes from
    Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error; 1/kp is the time constant", "my choice"),
    Parameter("ki", 0.002, "1/s^2", 0, 10, "gain of the gyro bias estimate", "my choice"),
)
PRESETS = {"gentle": {"kp": 0.2}, "eager": {"kp": 2.0}}

# Optional: values that follow from the log's own parameters (by name) and facts
# (attlog.estimators.LogInfo); a preset and what is asked for by name win.
# def from_log(params, info):
#     return {"kp": params["AHRS_RP_P"]} if "AHRS_RP_P" in params else {}


def start(params, acc, mag, q0):
    """The first state; q0 is the attitude that accelerometer and magnetometer show at the start."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def step(state, params, dt, gyr, acc, mag):
    """One update, in place: params in the order of PARAMETERS, dt [s] > 0.

    Plain numbers, elements of arrays, math and small functions of this file compile to
    machine code; the helpers in attlog.estimators.vectors do the usual vector maths.
    What numba cannot compile (a C library through ctypes) runs in plain Python, with a message.
    """
    kp, ki = params[0], params[1]
    gx, gy, gz = gravity_error(state, acc, 1.0)  # 0.0: direction of f only
    mx, my, mz = field_error(state, mag, 0.0)  # 1.0: the whole field vector
    ex, ey, ez = gx + mx, gy + my, gz + mz
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    turn(state, gyr[0] - state[4] + kp * ex, gyr[1] - state[5] + kp * ey, gyr[2] - state[6] + kp * ez, dt, 0.0)
'''

RUN_TEMPLATE = '''"""My filter: one line that says what it is.

This one takes whole segments: for packages and C libraries with a loop of their own, and for
smoothers. What follows is a small filter in plain Python; put your call in its place.

Frames: body is forward-right-down, earth north-east-down. q turns body vectors into
earth vectors, scalar first. gyr [rad/s], acc [m/s^2] is specific force (at rest
(0, 0, -9.8) when level), mag in any unit.
"""

import numpy as np

from attlog.estimators import Estimate, Parameter, propagated
from attlog.estimators.start import start_attitude
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "where the equations come from"
NEEDS = {"gyro", "acc"}  # cannot run without
USES = {"mag"}  # takes it when there; gnss, baro, airspeed, at_rest come in aids
CAUSAL = True  # False for a smoother: the report then says that it looks ahead
PARAMETERS = (
    # name, default, unit, lowest, highest, meaning, where the default comes from
    Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error; 1/kp is the time constant", "my choice"),
)
PRESETS = {"gentle": {"kp": 0.2}, "eager": {"kp": 2.0}}


def run(t, gyr, acc, mag, aids, params):
    """The attitude at every time of one segment: rising times without long gaps.

    t (n,) s; gyr, acc, mag (n, 3), gyr the mean rate since the sample before; acc zero where
    there is none, mag NaN where no new sample came. aids is attlog.estimators.Aids of this
    segment, None where there is nothing; aids.mag has the magnetometer at its own times.
    params maps names to values.
    """
    field = propagated(t, gyr, mag)  # what a slow magnetometer would show now
    kp = params["kp"]
    q = np.empty((len(t), 4))
    state = start_attitude(acc[0], field[0])
    for k in range(len(t)):
        if k:
            gx, gy, gz = gravity_error(state, acc[k - 1], 1.0)  # state is still the attitude of k - 1
            mx, my, mz = field_error(state, field[k - 1], 0.0)
            w = gyr[k] + kp * np.array([gx + mx, gy + my, gz + mz])
            turn(state, w[0], w[1], w[2], t[k] - t[k - 1], 0.0)
        q[k] = state
    return Estimate(t=t, q=q)  # bias=(n, 3) rad/s and aux={"name": (n, k)} may be added
'''


def new_command(
    file: Annotated[Path, typer.Argument(metavar="FILE.py", help="Write this file, which must not exist.")],
    run: Annotated[
        bool, typer.Option("--run", help="Write one that takes whole segments: for packages, C libraries, smoothers.")
    ] = False,
) -> None:
    """Write a filter of your own to start from.

    The file is commented and passes the checks as it is.

    Example: attlog new my_filter.py
    """
    from attlog.cli.printing import to_stdout
    from attlog.core.errors import OutputError, UsageError
    from attlog.core.files import write_atomic

    if file.suffix != ".py":
        raise UsageError(f"{file}: a filter is a Python file; give it the suffix .py")
    if os.path.exists(file):
        raise OutputError(f"{file}: exists already and is not overwritten; choose another name")
    write_atomic(file, RUN_TEMPLATE if run else TEMPLATE)
    typed = f"./{file}" if str(file).startswith("-") else str(file)
    to_stdout(f"{file} written. Check it: attlog check-estimator {shlex.quote(typed)}")
    to_stdout(f"Run it beside the others: attlog analyze LOG --estimators {shlex.quote(f'default,{typed}')}")
