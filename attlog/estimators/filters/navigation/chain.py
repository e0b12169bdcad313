"""Turns one after the other. One function for the compiler."""

from __future__ import annotations

from typing import Any


def chain(steps: Any, q: Any) -> None:
    """``q`` (n, 4): the products of the turns ``steps`` (n, 4) up to each row, the first of them taken as none."""
    a, b, c, d = 1.0, 0.0, 0.0, 0.0
    for k in range(len(steps)):
        if k > 0:
            w, x, y, z = steps[k, 0], steps[k, 1], steps[k, 2], steps[k, 3]
            a, b, c, d = (
                a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
                a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
            )  # fmt: skip
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = a, b, c, d
