"""Figures of the questions about the sensors, drawn from the questions' own arrays; they go packed into the page.

Traces without a row, all but the track ending at the first crash, with at most MOST samples each:
``compass``: the field (uT, body axes) over time, ``key`` the compass, the one in use first: x y z measured,
expected_x ... of the earth's field turned by an attitude, corrected_x ... less what is offered as an offset; value
``by_motion`` 1 where that attitude has its heading by motion alone;
``interference``: residual (uT), the field's size less the earth's, against ``t``, which is the drive: A with ``key``
current, % with ``key`` throttle; values ``slope`` (uT per unit of the drive), ``start`` (uT), ``r``, ``seconds``;
``levels``: level of vibration in flight (m/s^2) by the firmware's own measure, second by second, ``key`` its record;
values ``p50 p80 worst``, and ``limit`` and ``fault`` of the firmware where it has one;
``clipping``: samples of the accelerometer that the vehicle counted as clipped, of the unit with most, by the second in
which they came (where there are any), ``key`` the counter; value ``samples`` in all;
``rotor``: ``t`` the rotors' fundamental and its harmonics (Hz), low and high: how far they went in flight;
``notches``: ``t`` the middle of notch filters of the gyro (Hz), low and high their edges, ``key`` set or proposed;
``ratios``: test ratio of an aid of the onboard estimator, above 1 rejected, ``key`` the aid;
``track``: the path over ground by GNSS: north east (m), heading of the onboard attitude and course (deg, NaN where too
slow), speed (m/s), driven (1 in the air, of ground vehicles armed), ``key`` the receiver; values ``lat lon`` of zero,
``least`` speed for a course, ``forward`` 1 where heading and course agree by design, and where there are enough
``difference low high``: median and quartiles of heading minus course, and ``seconds``.
"""

from __future__ import annotations

from attlog.flight.model import part_of
from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.figures.compass import field, interference
from attlog.health.figures.estimator import ratios
from attlog.health.figures.track import track
from attlog.health.figures.vibration import clipping, levels, notches, rotor
from attlog.metrics.figures.trace import Trace


def traces(case: HealthCase, found: list[Assessment]) -> list[Trace]:
    """All traces that the log can fill; ``found``: what the questions answered, which says what is offered."""
    parts = [
        part_of(case.log, "The figure of the field", lambda: field(case, found), list[Trace]),
        part_of(case.log, "The figure of the interference", lambda: interference(case), list[Trace]),
        part_of(case.log, "The figure of the vibration", lambda: [*levels(case), *clipping(case)], list[Trace]),
        part_of(case.log, "The bands of the spectrum", lambda: [*rotor(case), *notches(case)], list[Trace]),
        part_of(case.log, "The figure of the test ratios", lambda: ratios(case), list[Trace]),
        part_of(case.log, "The ground track", lambda: track(case), list[Trace]),
    ]
    return [trace for part in parts for trace in part]
