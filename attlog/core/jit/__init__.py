"""Loops over arrays and numbers as machine code, compiled once and kept: see :mod:`attlog.core.jit.loops`."""

from attlog.core.jit.loops import (
    B1,
    F1,
    F2,
    F3,
    I1,
    Cells,
    IOut1,
    Loop,
    Out1,
    Out2,
    Out3,
    aligned_zeros,
    jit_wanted,
    last_before,
    loop,
    plain_python,
)

__all__ = [
    "B1",
    "F1",
    "F2",
    "F3",
    "I1",
    "Cells",
    "IOut1",
    "Loop",
    "Out1",
    "Out2",
    "Out3",
    "aligned_zeros",
    "jit_wanted",
    "last_before",
    "loop",
    "plain_python",
]
