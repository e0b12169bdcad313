"""Huang's table 1: what Mahony's filter costs beside an EKF, compiled and in numpy."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.present.numbers import number, quantity
from attlog.reproduce.cost import MEASURED, UPDATES
from attlog.reproduce.huang.runs import DCM, EKF
from attlog.reproduce.huang.tables import PRINTED_EKF_S, PRINTED_MAHONY_S
from attlog.reproduce.judge import above, ends, mean, ratio, together
from attlog.reproduce.paper import Claim, PaperNumber


def costs_less(
    spent: dict[str, list[float]], slow: dict[str, list[float]], numpy: tuple[list[float], list[float]]
) -> Claim:
    printed = ratio("the paper's own: EKF over Mahony", PRINTED_EKF_S, PRINTED_MAHONY_S)
    own = ratio("EKF over Mahony, compiled, a field at every update", spent[EKF], spent[DCM])
    rare = ratio("EKF over Mahony, compiled, a field at every 8th update", slow[EKF], slow[DCM])
    arrays = ratio("EKF with 7 states over Mahony, both plain numpy arrays", numpy[1], numpy[0])
    each = [
        mean(f"{UPDATES:,} updates of {name}", spent[row], "us") for row, name in ((DCM, "Mahony"), (EKF, "the EKF"))
    ]
    compiled = (each[0].value or 0.0) / UPDATES
    interpreted = [
        mean(f"an update of {name} in numpy", [1e-3 * ns for ns in found], "us")
        for name, found in zip(("Mahony", "the EKF"), numpy, strict=True)
    ]
    return Claim(
        "cost",
        "It takes less time than the EKF, about half.",
        "table 1",
        f"{MEASURED} mahony_dcm@huang and ekf12@fan, 12 states in blocks. Beside them the same filter and a dense "
        "EKF of 7 states as numpy arrays. Holds if all intervals of the ratio are above 1.",
        (own, arrays, rare, *each, *interpreted, printed),
        together([above(n, 1.0) for n in (own, arrays, rare)]),
        f"The direction holds, the number is the implementation's: {_ratio_text((own, rare))} compiled, "
        f"{quantity(arrays.value, 'ratio')} in numpy. The paper's 0.27 ms an update is interpreted code: in numpy "
        f"Mahony's takes {quantity(interpreted[0].value, 'us')}, compiled {quantity(compiled, 'us')}. "
        "Times are of this machine.",
        paper="1.084 s and 2.029 s, ratio 1.87",
        shown=2,
    )


def _ratio_text(numbers: Sequence[PaperNumber]) -> str:
    low, high = ends(numbers)
    return f"{number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}"
