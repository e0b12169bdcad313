"""Lyu's last results: the vehicle flies on the improved filter, which costs the processor hardly more."""

from __future__ import annotations

from attlog.present.numbers import below as bound
from attlog.present.numbers import quantity
from attlog.reproduce import cost
from attlog.reproduce.judge import below, difference, mean, ratio, share, together
from attlog.reproduce.lyu import flight as lyu_flight
from attlog.reproduce.lyu.flight import LyuFlight
from attlog.reproduce.lyu.runs import READINGS, fixed, variable
from attlog.reproduce.paper import Claim, PaperNumber

IN_CONTROL_DEG = 45.0
"""Section 2 takes a vehicle beyond 45 deg for unstable."""
HARDLY = 1.5


def flies(found: list[dict[str, LyuFlight]]) -> Claim:
    """No flight is out of control."""
    kinds = (("variable integral", variable), ("fixed integral", fixed))
    each = {name: [f[kind(r)] for f in found for r in READINGS] for name, kind in kinds}
    most, kept = (
        [
            mean(f"largest true tilt, {name}", [one.most_deg for one in flights], "deg")
            for name, flights in each.items()
        ],
        [
            share(f"flights in control, {name}", [not one.landed and one.most_deg < IN_CONTROL_DEG for one in flights])
            for name, flights in each.items()
        ],
    )
    numbers = [
        difference(
            f"{what}, variable minus fixed, ki per {reading}",
            [getattr(f[variable(reading)], field) for f in found],
            [getattr(f[fixed(reading)], field) for f in found],
            "deg",
        )
        for reading in READINGS
        for what, field in (("error of tilt", "error_deg"), ("distance of roll from its set-point", "tracking_deg"))
    ]
    size = mean("error of tilt, fixed integral, ki per second", [f[fixed("second")].error_deg for f in found], "deg")
    e = PaperNumber("largest |e| in flight, of 1", max(one.largest_e for f in found for one in f.values()), "")
    equal = share("flights that are equal to the last bit", [f[variable(r)].equal for f in found for r in READINGS])
    lost = any(n.value != 100.0 for n in kept)
    return Claim(
        "flight",
        "Flown on the improved filter the vehicle is stable and does not lose control.",
        "section 3.2",
        "Largest true tilt from take-off on; the set-point of roll swings by "
        f"{lyu_flight.AMPLITUDE_DEG:g} deg. Out of control: beyond {IN_CONTROL_DEG:g} deg, or on the ground. Holds if "
        f"no flight is, and the interval of the tilt is below {IN_CONTROL_DEG:g} deg.",
        (kept[0], most[0], kept[1], most[1], size, *numbers, equal, e),
        "does not hold" if lost else together([below(n, IN_CONTROL_DEG) for n in most]),
        f"Both filters {'do not keep every flight' if lost else 'keep every flight'} in control. They differ by "
        f"{reach(numbers, 'deg')}; the error of tilt is {quantity(size.value, 'deg')}. "
        f"{quantity(equal.value, 'pct')} of the pairs of flights are equal to the last bit: |e| reaches {e.value:.2f}.",
        shown=2,
    )


def dearer(spent: dict[str, list[float]]) -> Claim:
    """Time per update; ``spent`` of :func:`attlog.reproduce.cost.nanoseconds`."""
    new, old = variable("second"), fixed("second")
    one = ratio("time per update, variable over fixed integral", spent[new], spent[old])
    each = [
        mean(f"time per update, {name} integral", spent[row], "ns") for name, row in (("variable", new), ("fixed", old))
    ]
    more = (each[0].value or 0.0) - (each[1].value or 0.0)
    return Claim(
        "cost",
        "The improved filter costs the processor hardly more.",
        "section 4",
        f"{cost.MEASURED} Hardly more is less than half more: holds if the interval of the ratio is below {HARDLY:g}.",
        (one, *each),
        below(one, HARDLY),
        f"The size of the error and the ratio of (17) add {quantity(more, 'ns')} to {quantity(each[1].value, 'ns')}. "
        "Times are of this machine.",
    )


def reach(numbers: list[PaperNumber], unit: str) -> str:
    """Where the numbers lie, in words: from the smallest to the largest, or that all are too small to see."""
    values = [n.value for n in numbers if n.value is not None]
    largest = max(map(abs, values))
    if largest < {"s": 0.05, "deg": 0.05}[unit]:
        return f"less than {bound(largest, unit)} either way"
    return f"{quantity(min(values), unit, True)} to {quantity(max(values), unit, True)}"
