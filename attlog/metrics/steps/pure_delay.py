"""May a lag be judged? Only where a row goes through the movement in the reference's shape, some time later."""

from __future__ import annotations

from attlog.metrics.steps.fit.solution import Fit

GAIN = (0.95, 1.05)
MAX_DISTORTION = 0.15
MAX_SHARE, MAX_SHARE_UNSOUND, MAX_SHARE_HEAVY = 0.7, 0.25, 0.15
HEAVY = 0.02
"""Where the specific force exceeds 2 g in more than this share of the time, a filter follows acceleration."""


def why_not(found: Fit, *, sound: bool, half_width: float, lag: float, earliest: float) -> str | None:
    """Why the lag (s) of a fit may not be judged, else None.

    ``sound`` tells that the row neither diverged nor failed to settle. A causal filter
    cannot come before ``earliest`` (s) by more than ``half_width`` (s).
    """
    if not GAIN[0] <= found.gain <= GAIN[1]:
        return f"follows {100 * found.gain:.0f} % of the movement ({GAIN[0]:.2f} to {GAIN[1]:.2f} can be judged)"
    if found.distortion > MAX_DISTORTION:
        return (
            f"shape error {100 * found.distortion:.0f} % of the movement ({100 * MAX_DISTORTION:.0f} % can be judged)"
        )
    most, where = MAX_SHARE, ""
    if not sound:
        most, where = MAX_SHARE_UNSOUND, " in a row that diverged or did not settle"
    if found.sums.heavy >= HEAVY:
        most, where = min(most, MAX_SHARE_HEAVY), " where the specific force exceeds 2 g"
    if found.share > most:
        turned = f"accelerometer and magnetometer turn it at {100 * found.share:.0f} % of the movement's rate"
        return f"{turned} ({100 * most:.0f} % can be judged{where})"
    if lag + half_width < 0.0 and lag < earliest:
        return f"comes out {-1000 * lag:.1f} ms early, which a causal filter cannot be"
    return None
