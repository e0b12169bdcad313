"""What was taken off the gyro for every filter alike, in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from attlog.present.numbers import duration

if TYPE_CHECKING:
    from attlog.result import CommonBias, Result


def gyro_bias(result: Result) -> list[str]:
    """A sentence for each replayed IMU: how much was taken off its gyro and where that is from, or why nothing was."""
    several = len(result.gyro_bias) > 1
    return [(f"{bias.imu}: " if several else "") + bias_sentence(bias) for bias in result.gyro_bias]


def bias_sentence(bias: CommonBias) -> str:
    """The sentence for one IMU."""
    if bias.dps is None:
        why = f": {bias.why}" if bias.why else " (--gyro-bias none)"
        return f"No gyro bias was taken off before the filters ran{why}."
    if bias.taken == "onboard":
        mean = axes(bias.dps)
        return f"Taken off the gyro for every filter: what the onboard estimator took off, in the mean {mean}."
    seconds = duration(bias.seconds)
    text = f"Taken off the gyro for every filter: {axes(bias.dps)}, its mean over {seconds} of rest"
    text += " before take-off" if bias.flew else ""
    if bias.half95_dps is not None:
        text += f" (±{max(bias.half95_dps):.2g} deg/s)"
    if bias.landed_dps is not None:
        moved = max(abs(after - before) for after, before in zip(bias.landed_dps, bias.dps, strict=True))
        text += f"; after landing it reads up to {moved:.2g} deg/s off that"
    return text + "."


def axes(dps: list[float]) -> str:
    """Three rates about the body axes."""
    x, y, z = (f"{0.0 if abs(v) < 0.0005 else v:+.3f}" for v in dps)
    return f"{x}, {y}, {z} deg/s about x, y, z"
