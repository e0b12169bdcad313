"""What was subtracted from the gyro for every filter alike, in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from attlog.present.numbers import duration

if TYPE_CHECKING:
    from attlog.result import CommonBias, Result


def gyro_bias(result: Result) -> list[str]:
    """A sentence for each replayed IMU: how much was subtracted from its gyro and why, or why nothing was."""
    several = len(result.gyro_bias) > 1
    return [(f"{bias.imu}: " if several else "") + bias_sentence(bias) for bias in result.gyro_bias]


def bias_sentence(bias: CommonBias) -> str:
    """The sentence for one IMU."""
    if bias.dps is None:
        why = f": {bias.why}" if bias.why else " (--gyro-bias none)"
        return f"No gyro bias was subtracted before the filters ran{why}."
    if bias.taken == "onboard":
        mean = axes(bias.dps)
        return f"Subtracted from the gyro for every filter: the onboard estimator's bias, in the mean {mean}."
    seconds = duration(bias.seconds)
    text = f"Subtracted from the gyro for every filter: {axes(bias.dps)}, its mean over {seconds} of rest"
    text += " before take-off" if bias.flew else ""
    if bias.half95_dps is not None:
        text += f" (±{max(bias.half95_dps):.2g} deg/s)"
    if bias.landed_dps is not None:
        moved = max(abs(after - before) for after, before in zip(bias.landed_dps, bias.dps, strict=True))
        text += f". After landing its mean differs by up to {moved:.2g} deg/s"
    return text + "."


def axes(dps: list[float]) -> str:
    """Three rates about the body axes."""
    x, y, z = (f"{0.0 if abs(v) < 0.0005 else v:+.3f}" for v in dps)
    return f"{x}, {y}, {z} deg/s about x, y, z"
