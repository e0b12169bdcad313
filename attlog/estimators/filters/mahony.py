"""The family of Mahony's complementary filter: an error of gravity and heading, a gain, and an integral of it.

        e_g = v x d                        v measured down (-f/|f| or -f/g), d = R^T e_z predicted down
        e_m = R^T (0, 0, -sin psi)         psi heading of the field R m; or the cross product with the whole field
        b'  = -ki e,   q' = q (x) (0, w - b + kp e)/2

Each class below is a registered filter and a namespace: its equations, sources, departures, gains and step.
"""

# ruff: noqa: RUF012

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, KI_PER, MAG_FORM, MAG_GAIN, Parameter, choice
from attlog.estimators.vectors import (
    GRAVITY,
    cross,
    field_error,
    gravity_error,
    is_present,
    matrix,
    matrix_from_quaternion,
    quaternion_from_matrix,
    turn,
    turn_matrix,
)

MAHONY_2008 = "Mahony2008 32"
GAIN = "proportional gain: large follows the accelerometer, small the gyro"
BIAS_GAIN = "gain of the gyro bias estimate; 0 estimates none"
# A filter that keeps the matrix has it from this place of its state on; its last row is d.
MATRIX, DOWN = 7, 13
# Low-passed force of ``mahony_adaptive``.
FORCE = 8


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude, and no bias yet."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def start_with_matrix(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude as quaternion and matrix, and no bias yet."""
    state = np.zeros(16)
    state[0:4] = q0
    matrix_from_quaternion(state, MATRIX)
    return state


def total_error(
    state: Any, acc: Any, mag: Any, acc_form: float, mag_form: float, mag_gain: float
) -> tuple[float, float, float]:
    """Return e_g + mag_gain e_m."""
    gx, gy, gz = gravity_error(state, acc, acc_form)
    mx, my, mz = field_error(state, mag, mag_form)
    return gx + mag_gain * mx, gy + mag_gain * my, gz + mag_gain * mz


def integrate(state: Any, ki_dt: float, ex: float, ey: float, ez: float) -> None:
    """Move the bias by the error times ``ki_dt``."""
    state[4] -= ki_dt * ex
    state[5] -= ki_dt * ey
    state[6] -= ki_dt * ez


def corrected_rate(state: Any, gyr: Any, kp: float, ex: float, ey: float, ez: float) -> tuple[float, float, float]:
    """Return the rate less the bias, and ``kp`` times the error."""
    return gyr[0] - state[4] + kp * ex, gyr[1] - state[5] + kp * ey, gyr[2] - state[6] + kp * ez


class Complementary:
    """Complementary filter with fixed PI gains: the classic that Fan and Lyu compare theirs with.

        e    = e_g + e_m                cross products of measured and predicted gravity and field
        I'   = e                        integral of the error; reported as gyro bias b = -ki I
        w'   = w + kp e + ki I
        q'   = q (x) (0, w')/2

    Source: Fan 14-18 and section 5 (preset ``fan``: kp 3, ki 0.01); Lyu's "traditional" filter, (13)-(16) with ratio 1,
    gains of section 3.1 (preset ``lyu-fixed``: kp 0.5, ki 0.001, no magnetometer).

    Departures. Fan's norm without root (1), sign of +w_by in row 2 of Omega (3) and diagonal of the DCM (4) are printed
    errors and stay out. Neither paper says whether ki is per second or per sample: ``ki_per``. Fan section 4 may start
    at q = (1, 0, 0, 0), ``init = identity``; the preset starts from the first vectors as every filter does, because
    from there the integral keeps a wrong heading for minutes (kp / ki = 300 s). Equations are those of ``mahony``.

    Defaults. kp: accelerations of 3 s average out (docs/estimators.md). kp / ki = 100 s is slower than a flight's
    accelerations. mag_gain: a field near motors is the worse reference, and a gyro holds heading for 7 s.
    """

    SOURCE = "Fan 14-18 and section 5; Lyu 13-16"
    EQUATION = MAHONY_2008
    NEEDS = frozenset({"gyro", "acc"})
    USES = frozenset({"mag"})
    STATE = {"q": 4, "bias": 3}
    PARAMETERS = (
        Parameter("kp", 0.35, "1/s", 0, 100, GAIN, "attlog; averages accelerations of 3 s"),
        Parameter("ki", 0.0035, "1/s^2", 0, 10, BIAS_GAIN, "attlog; kp / ki = 100 s"),
        replace(MAG_GAIN, default=0.4, source="attlog; a field near motors is the worse reference"),
        MAG_FORM,
        ACC_FORM,
        INTEGRATOR,
        KI_PER,
    )
    PRESETS = {
        "fan": {"kp": 3.0, "ki": 0.01, "mag_gain": 1.0, "mag_form": "vector", **AS_PRINTED},
        "lyu-fixed": {"kp": 0.5, "ki": 0.001, "mag_gain": 0.0, **AS_PRINTED},
    }
    start = start

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: both errors, integral, rate, attitude."""
        kp, ki, mag_gain = params[0], params[1], params[2]
        mag_form, acc_form, integrator, ki_per = params[3], params[4], params[5], params[6]
        ex, ey, ez = total_error(state, acc, mag, acc_form, mag_form, mag_gain)
        integrate(state, ki * (1.0 if ki_per > 0.5 else dt), ex, ey, ez)
        wx, wy, wz = corrected_rate(state, gyr, kp, ex, ey, ez)
        turn(state, wx, wy, wz, dt, integrator)


class VariableIntegral:
    """Complementary filter with variable integral: the integral is faded out where the error is large.

        e      = e_g + e_m                      sines of the angles of gravity (13-15) and field
        I'     = e
        e_adj  = kp e + ratio ki I              (16)
        ratio  = 1                              |e| < err1                                                  (17)
               = (err2 - |e|) / (err2 - err1)   err1 <= |e| <= err2
               = 0                              |e| > err2
        w'     = w + e_adj                      (18)
        q'     = q (x) (0, w')/2                (8-10)

    Source: Lyu 11-18, values of section 3.1 (preset ``lyu``: kp 0.5, ki 0.001, err1 0.3, err2 0.8, no magnetometer,
    first-order step). Reported as gyro bias is ``b = -ki I``.

    Departures. Printed frames are left-handed and matrix (1) is garbled in places: both are translated to FRD and NED.
    |e| is the norm of the vector. The ratio scales the integral's output as printed; ``freeze = input`` scales what is
    accumulated instead, the usual anti-windup. Lyu does not say whether ki is per second or per sample: ``ki_per``.

    Defaults. kp as complementary; ki may be larger because it fades where errors are large.

    Know this: err1 = 0.3 is an error of 17 deg. At rest and in gentle motion the ratio is 1 and the filter is
    ``complementary``; it can be neither quieter nor slower there. With 3 m/s^2 (RMS) of vibration the mean error is
    above err1; then it is some percent quieter with ki per sample.
    """

    SOURCE = "Lyu 11-18"
    NEEDS = frozenset({"gyro", "acc"})
    USES = frozenset({"mag"})
    STATE = {"q": 4, "bias": 3, "ratio": 1}
    PARAMETERS = (
        Parameter("kp", 0.3, "1/s", 0, 100, GAIN, "attlog; as complementary"),
        Parameter("ki", 0.005, "1/s^2", 0, 10, BIAS_GAIN, "attlog; it fades where errors are large"),
        Parameter("err1", 0.3, "1", 0, 2, "error (sine) up to which the integral works in full", "Lyu section 3.1"),
        Parameter("err2", 0.8, "1", 0, 2, "error (sine) from which it is off; below err1: a switch", "Lyu section 3.1"),
        replace(MAG_GAIN, default=0.5, source="attlog; as complementary"),
        MAG_FORM,
        ACC_FORM,
        INTEGRATOR,
        KI_PER,
        choice("freeze", ("output", "input"), "what the ratio scales", "Lyu 16 prints output"),
    )
    PRESETS = {"lyu": {"kp": 0.5, "ki": 0.001, "err1": 0.3, "err2": 0.8, "mag_gain": 0.0, **AS_PRINTED}}

    def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
        """Return the state: attitude, no bias yet, ratio 1."""
        return np.append(start(params, acc, mag, q0), 1.0)

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: errors, ratio, integral, rate, attitude."""
        kp, ki, err1, err2, mag_gain = params[0], params[1], params[2], params[3], params[4]
        mag_form, acc_form, integrator, ki_per, freeze = params[5], params[6], params[7], params[8], params[9]
        ex, ey, ez = total_error(state, acc, mag, acc_form, mag_form, mag_gain)
        ratio = faded(math.sqrt(ex * ex + ey * ey + ez * ez), err1, err2)
        output = 1.0 if freeze > 0.5 else ratio
        integrate(state, ki * (1.0 if ki_per > 0.5 else dt) * (ratio if freeze > 0.5 else 1.0), ex, ey, ez)
        state[7] = ratio
        wx = gyr[0] - output * state[4] + kp * ex
        wy = gyr[1] - output * state[5] + kp * ey
        wz = gyr[2] - output * state[6] + kp * ez
        turn(state, wx, wy, wz, dt, integrator)


def faded(x: float, full: float, none: float) -> float:
    """Return 1 below ``full``, 0 from ``none`` on, linear between; a switch at ``full`` where ``none`` is not above."""
    width = none - full
    fade = (none - x) / width if width > 0.0 else 0.0
    fade = fade if fade > 0.0 else 0.0
    return 1.0 if x < full else fade


class MahonyPassive:
    """Mahony's passive complementary filter: follows an attitude rebuilt from gravity and field.

        R_y  = argmin  l1 |e_z - R v|^2 + l2 |v_m* - R v_m|^2        (7)  Wahba's problem, v = -f/|f|
        w    = vex(Pa(R^T R_y)),  Pa(A) = (A - A^T)/2                (10)
        w   += (mag_gain - 1) (w.d) d,  d = R^T e_z                  mag_gain 1 is the papers'
        b'   = -ki w                                                 (9)
        R'   = R [Omega - b + kp w]x                                 (8)

    Source: Huang 7-10 (preset ``huang``: kp 0.3, ki 0.01); Mahony2008, equations 13 (passive filter). Wahba's problem
    with two vectors has a closed solution (Markley2002, equations 13 and 22):

        R_y = r_3 b_3^T + sum over i = 1, 2 of  a_i / lambda (r_i b_i^T + (r_i x r_3)(b_i x b_3)^T)
        lambda^2 = a_1^2 + a_2^2 + 2 a_1 a_2 ((b_1.b_2)(r_1.r_2) + |b_1 x b_2| |r_1 x r_2|)

    with b_i measured in the body, r_i expected in the earth, b_3, r_3 the unit cross products. With l1 >> l2 it is
    TRIAD: gravity gives the tilt, the field only heading.

    Departures. Huang (4) has v_a ~ -R^T e_z and yet (7) compares e_z with R v_a: one sign is wrong; v here points down.
    v_m* is the field turned to the earth by the estimate with its east part removed, so no dip need be known. Where the
    field is missing (or points along gravity) w = v x d, gravity alone.

    Defaults. kp and ki are below Huang's 0.3 and 0.01 (tables 2 and 3): the filter follows directions, in which
    accelerations do not average out, and accelerations of half a minute would become bias. Only l1 / l2 counts; Huang
    gives no value.
    """

    SOURCE = "Huang 7-10; Mahony2008 13; Markley2002 13 and 22"
    NEEDS = frozenset({"gyro", "acc", "mag"})
    STATE = {"q": 4, "bias": 3, "_matrix": 9}
    PARAMETERS = (
        Parameter("kp", 0.2, "1/s", 0, 100, GAIN, "attlog; below Huang's 0.3"),
        Parameter("ki", 0.003, "1/s^2", 0, 10, BIAS_GAIN, "attlog; below Huang's 0.01"),
        Parameter("l1", 1.0, "1", 1e-6, 1e6, "weight of gravity in the rebuilt attitude", "attlog; l1 / l2 counts"),
        Parameter("l2", 0.01, "1", 1e-6, 1e6, "weight of the field: small keeps it out of roll and pitch", "attlog"),
        replace(MAG_GAIN, default=0.5, source="attlog; as mahony"),
        INTEGRATOR,
    )
    PRESETS = {"huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0, "integrator": "first_order"}}
    start = start_with_matrix

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: rebuilt attitude, error, bias, rate, matrix, and the quaternion that follows it."""
        kp, ki, l1, l2, mag_gain, integrator = params[0], params[1], params[2], params[3], params[4], params[5]
        ex, ey, ez = rebuilt_error(state, l1, l2, acc, mag)
        # The part along d is heading; gravity has none there.
        more = (mag_gain - 1.0) * (ex * state[DOWN] + ey * state[DOWN + 1] + ez * state[DOWN + 2])
        ex, ey, ez = ex + more * state[DOWN], ey + more * state[DOWN + 1], ez + more * state[DOWN + 2]
        integrate(state, ki * dt, ex, ey, ez)
        wx, wy, wz = corrected_rate(state, gyr, kp, ex, ey, ez)
        turn_matrix(state, MATRIX, wx, wy, wz, dt, integrator)
        quaternion_from_matrix(state, MATRIX)


class MahonyDcm:
    """Mahony's filter on the direction cosine matrix, as small autopilots run it.

        d    = third row of R, d = R^T e_z              predicted down in body axes
        e_g  = v x d,  v = -f/|f|                       gravity error
        e_m  = -sin(psi) d                              psi: signed horizontal angle from expected to measured field
        e    = e_g + mag_gain e_m
        b'   = -ki e
        R'   = R [w - b + kp e]x
        r    = r_x . r_y / 2,  r_x -= r r_y,  r_y -= r r_x,  r_i = (3 - |r_i|^2) r_i / 2,  r_z = r_x x r_y

    Source: Huang 2.3.2 (the filter) on the matrix of 2.3.1 with its renormalisation, which is Premerlani2009's; gains
    of figure 3 (preset ``huang``: kp 0.3, ki 0.01, first-order step, meant for 400 Hz). Tables 2 and 3 are the gains of
    the controller.

    Departures. The dot in r_x . r_y is missing in print. The heading error of 2.3.2 is |Hm x Hc|, the measured field
    with the body x axis: without a sign, which would drive the nose to magnetic north, and with a factor cos(dip). The
    working meaning is the signed horizontal angle above; ``heading_error = printed`` (preset ``huang``) keeps the
    factor, which is 1 where the field is level and halves the gain on heading at a dip of 60 deg. Printed with
    a = f/|f| the gravity error diverges; the sign here is tested on motion. It is ``mahony`` with another way to
    integrate: both agree to the integration error.

    Defaults. ki is half of Huang's 0.01 (fig. 3), which turns accelerations of half a minute into bias.
    """

    SOURCE = "Huang 2.3.2; Premerlani2009 (renormalisation)"
    EQUATION = MAHONY_2008
    NEEDS = frozenset({"gyro", "acc", "mag"})
    STATE = {"q": 4, "bias": 3, "_matrix": 9}
    PARAMETERS = (
        Parameter("kp", 0.3, "1/s", 0, 100, GAIN, "Huang fig. 3"),
        Parameter("ki", 0.005, "1/s^2", 0, 10, BIAS_GAIN, "attlog; half of Huang's 0.01 (fig. 3)"),
        replace(MAG_GAIN, default=0.5, source="attlog; as mahony"),
        choice("heading_error", ("sine", "printed"), "sine of the angle, or that times cos(dip)", "attlog"),
        MAG_FORM,
        ACC_FORM,
        INTEGRATOR,
    )
    PRESETS = {"huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0, "heading_error": "printed", **AS_PRINTED}}
    start = start_with_matrix

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: both errors, bias, rate, matrix, and the quaternion that follows it."""
        kp, ki, mag_gain, heading_error = params[0], params[1], params[2], params[3]
        mag_form, acc_form, integrator = params[4], params[5], params[6]
        gain = mag_gain * (cos_dip(state, mag) if heading_error > 0.5 else 1.0)
        ex, ey, ez = total_error(state, acc, mag, acc_form, mag_form, gain)
        integrate(state, ki * dt, ex, ey, ez)
        wx, wy, wz = corrected_rate(state, gyr, kp, ex, ey, ez)
        turn_matrix(state, MATRIX, wx, wy, wz, dt, integrator)
        quaternion_from_matrix(state, MATRIX)


class Mahony:
    """Mahony's explicit complementary filter: one gain on the sum of gravity and heading error.

        e   = e_g + mag_gain e_m        e_g = v x d,  v = -f/g measured, d = R^T e_z predicted down
                                        e_m = R^T (0, 0, -sin psi), psi heading of the field R m
        b'  = -ki e                     gyro bias [rad/s]
        q'  = q (x) (0, w - b + kp e)/2

    Source: Mahony2008 (explicit filter, equations 32); Xu section 2, who varies kp on Pixhawk logs (section 3: 0.6,
    1.1, 2; section 4: 0.6 to 1.1 are best) and does not state ki (presets, without bias).

    Departures. Xu section 2 turns the accelerometer into a quaternion rate by gradient descent and adds it to the
    gyro's; here the cross product of the filter that gives the paper its name does, the gradient step is ``madgwick``.
    Xu's frames (right-forward-up, ENU, order Z-X-Y) are translated to FRD and NED. Printed errors stay out: (3) loses a
    factor 2 in 2 q1^2, rows 2-4 of (10) are permuted, (11) and (15) print the same quotient twice and use arctan for
    atan2. ``mag_form = vector`` is Mahony's cross product with the whole field, ``integrator = first_order`` Xu's
    (6-10), ``acc_form = direction`` his unit vector.

    Defaults. f/g in place of f/|f|: on 12 BROAD trials tilt falls from 4.2 to 2.5 deg (kp 0.6), on four EuRoC flights
    it stays (6.0 and 6.1 deg). kp is below the 0.6 to 1.1 that are best of Xu's section 4, because every acceleration
    tilts by kp; 1/kp is the time constant. kp / ki is about 100 s. mag_gain 1 is Mahony2008.
    """

    SOURCE = "Mahony2008 32; Xu section 2, gains section 3"
    EQUATION = MAHONY_2008
    NEEDS = frozenset({"gyro", "acc"})
    USES = frozenset({"mag"})
    STATE = {"q": 4, "bias": 3}
    PARAMETERS = (
        Parameter("kp", 0.45, "1/s", 0, 100, GAIN, "attlog; below the best of Xu's section 4"),
        Parameter("ki", 0.004, "1/s^2", 0, 10, BIAS_GAIN, "attlog; kp / ki about 100 s"),
        replace(MAG_GAIN, default=0.5, source="attlog; a field near motors is the worse reference"),
        MAG_FORM,
        ACC_FORM,
        INTEGRATOR,
    )
    PRESETS = {f"xu-{kp:g}": {"kp": kp, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED} for kp in (0.6, 1.1, 2.0)}
    start = start

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: both errors, bias, rate, attitude."""
        kp, ki, mag_gain, mag_form, acc_form, integrator = (
            params[0],
            params[1],
            params[2],
            params[3],
            params[4],
            params[5],
        )
        ex, ey, ez = total_error(state, acc, mag, acc_form, mag_form, mag_gain)
        integrate(state, ki * dt, ex, ey, ez)
        wx, wy, wz = corrected_rate(state, gyr, kp, ex, ey, ez)
        turn(state, wx, wy, wz, dt, integrator)


class MahonyAdaptive:
    """Mahony's filter with a gain that fades when the accelerometer shows more than gravity.

        F'     = (R f - F) / tau                specific force in earth axes, low-passed
        s      = 1                              a < thr1,  a = | |F| - g | / g
               = (thr2 - a) / (thr2 - thr1)     thr1 <= a <= thr2
               = 0                              a > thr2
        e      = s e_g + mag_gain e_m           e_g, e_m as in ``mahony``
        k      = kp (1 + rate_gain |w - b|)
        b'     = -ki e
        q'     = q (x) (0, w - b + k e)/2

    Source: Xu, whose abstract promises an adaptive gain but prints no law. **The law here is ours**: the piecewise
    factor of Valenti2015 (equations 60-62), applied to the gravity error only, because an acceleration says nothing
    about the field. The optional rate term raises the gain while the body turns, where gyro scale errors grow; it is
    off by default. Preset ``xu``: kp 0.6, where Xu's best fixed gains begin (section 4), without bias.

    What is compared with g is not the sample but the specific force low-passed in earth axes, where turning leaves it
    alone: 15 m/s^2 of vibration makes |f| of every sample too large, and a filter that compares it never corrects its
    tilt again.

    Departures. An acceleration across gravity hardly changes |f| and passes the test: 10 % in norm is 0.46 g sideways.
    ``acc_form = vector`` (the default; ``direction`` as printed) treats those better.

    Defaults. kp is half of the 0.6 where the best of Xu's section 4 begin. ki is larger than in mahony: long
    accelerations, which it takes for bias, are left out. tau: rotors shake above 5 Hz, manoeuvres last longer than half
    a second.
    """

    SOURCE = "Xu section 3 (gains); Valenti2015 60-62 (law)"
    NEEDS = frozenset({"gyro", "acc"})
    USES = frozenset({"mag"})
    STATE = {"q": 4, "bias": 3, "trust": 1, "_force": 3}
    PARAMETERS = (
        Parameter("kp", 0.3, "1/s", 0, 100, "gain where the accelerometer is trusted in full", "attlog; half of Xu's"),
        Parameter("ki", 0.006, "1/s^2", 0, 10, BIAS_GAIN, "attlog; long accelerations are left out"),
        Parameter("thr1", 0.1, "1", 0, 10, "deviation of |f| from g, in g, up to which it is trusted", "Valenti2015"),
        Parameter("thr2", 0.2, "1", 0, 10, "deviation from which it is not used; below thr1: a switch", "Valenti2015"),
        Parameter("rate_gain", 0.0, "s/rad", 0, 100, "growth of the gain per rad/s of body rate", "attlog; 0 is off"),
        replace(MAG_GAIN, default=0.5, source="attlog; as mahony"),
        Parameter("tau", 0.1, "s", 0, 100, "time constant of the force that is compared with g; 0: none", "attlog"),
        MAG_FORM,
        ACC_FORM,
        INTEGRATOR,
    )
    PRESETS = {"xu": {"kp": 0.6, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED}}

    def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
        """Return the state: attitude, no bias yet, full trust, gravity alone."""
        return np.append(start(params, acc, mag, q0), [1.0, 0.0, 0.0, -GRAVITY])

    def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
        """Take one update: trust, both errors, bias, rate, attitude."""
        kp, ki, thr1, thr2, rate_gain = params[0], params[1], params[2], params[3], params[4]
        mag_gain, tau, mag_form, acc_form, integrator = params[5], params[6], params[7], params[8], params[9]
        deviation = math.fabs(smooth_force(state, tau, dt, acc) - GRAVITY) / GRAVITY
        trust = faded(deviation, thr1, thr2)
        gx, gy, gz = gravity_error(state, acc, acc_form)
        mx, my, mz = field_error(state, mag, mag_form)
        ex, ey, ez = trust * gx + mag_gain * mx, trust * gy + mag_gain * my, trust * gz + mag_gain * mz
        integrate(state, ki * dt, ex, ey, ez)
        state[7] = trust
        wx, wy, wz = corrected_rate(state, gyr, 0.0, ex, ey, ez)
        k = kp * (1.0 + rate_gain * math.sqrt(wx * wx + wy * wy + wz * wz))
        turn(state, wx + k * ex, wy + k * ey, wz + k * ez, dt, integrator)


FAMILY = {
    "complementary": Complementary,
    "variable_integral": VariableIntegral,
    "mahony_passive": MahonyPassive,
    "mahony_dcm": MahonyDcm,
    "mahony": Mahony,
    "mahony_adaptive": MahonyAdaptive,
}


def cos_dip(state: Any, mag: Any) -> float:
    """Return |Hm x Hc| / sin(psi), the level part of the field by the estimated down axis; 1 without a field."""
    square = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
    down = mag[0] * state[DOWN] + mag[1] * state[DOWN + 1] + mag[2] * state[DOWN + 2]
    level = 1.0 - down * down / square if square > 0.0 else 1.0
    return math.sqrt(level) if level > 0.0 else 0.0


def smooth_force(state: Any, tau: float, dt: float, acc: Any) -> float:
    """Take one step of the low-pass towards R f; return |F| in m/s^2. A missing sample changes nothing."""
    R = matrix(state, 0)
    share = dt / (tau + dt) if is_present(acc) else 0.0
    square = 0.0
    for i in range(3):
        force = R[3 * i] * acc[0] + R[3 * i + 1] * acc[1] + R[3 * i + 2] * acc[2]
        state[FORCE + i] += share * (force - state[FORCE + i])
        square += state[FORCE + i] * state[FORCE + i]
    return math.sqrt(square)


def rebuilt_error(state: Any, l1: float, l2: float, acc: Any, mag: Any) -> tuple[float, float, float]:
    """Return vex(Pa(R^T R_y)) (10): the body rotation from the estimate to the rebuilt attitude, sine of the angle.

    With ``c_i = R^T r_i``, the expected vectors in estimated body axes, R^T R_y is the sum of
    products ``c b^T`` and the vector of each is ``vex(Pa(c b^T)) = (b x c)/2``.
    """
    dx = state[13]
    dy = state[14]
    dz = state[15]
    vx, vy, vz = unit(-acc[0], -acc[1], -acc[2])
    mx, my, mz = unit(mag[0], mag[1], mag[2])
    # v_m* in body axes: the measured field with its east part turned into north.
    hx = state[7] * mx + state[8] * my + state[9] * mz
    hy = state[10] * mx + state[11] * my + state[12] * mz
    hz = dx * mx + dy * my + dz * mz
    level = math.sqrt(hx * hx + hy * hy)
    fx = level * state[7] + hz * dx
    fy = level * state[8] + hz * dy
    fz = level * state[9] + hz * dz
    # Third axis of both pairs: gravity x field.
    px, py, pz, measured = unit_cross(vx, vy, vz, mx, my, mz)
    rx, ry, rz, expected = unit_cross(dx, dy, dz, fx, fy, fz)
    if measured == 0.0 or expected == 0.0:
        return cross(vx, vy, vz, dx, dy, dz)
    cosines = (vx * mx + vy * my + vz * mz) * (dx * fx + dy * fy + dz * fz)
    scale = math.sqrt(l1 * l1 + l2 * l2 + 2.0 * l1 * l2 * (cosines + measured * expected))
    a1 = l1 / scale if scale > 0.0 else 0.0
    a2 = l2 / scale if scale > 0.0 else 0.0
    ax, ay, az = pair_error((vx, vy, vz), (px, py, pz), (dx, dy, dz), (rx, ry, rz))
    bx, by, bz = pair_error((mx, my, mz), (px, py, pz), (fx, fy, fz), (rx, ry, rz))
    cx, cy, cz = cross(px, py, pz, rx, ry, rz)
    return a1 * ax + a2 * bx + 0.5 * cx, a1 * ay + a2 * by + 0.5 * cy, a1 * az + a2 * bz + 0.5 * cz


def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the unit vector; a zero vector stays zero."""
    norm = math.sqrt(x * x + y * y + z * z)
    inv = 1.0 / norm if norm > 0.0 else 0.0
    return x * inv, y * inv, z * inv


def unit_cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float, float]:
    """Return the direction of a x b and its length; zero for zero vectors and parallel ones."""
    x, y, z = cross(ax, ay, az, bx, by, bz)
    norm = math.sqrt(x * x + y * y + z * z)
    inv = 1.0 / norm if norm > 1e-9 else 0.0
    return x * inv, y * inv, z * inv, norm if norm > 1e-9 else 0.0


Vector = tuple[float, float, float]


def pair_error(b: Vector, p: Vector, c: Vector, r: Vector) -> Vector:
    """Return (b x c)/2 + ((b x p) x (c x r))/2, a vector pair's share in (10); p and r are the third axes."""
    bc = cross(b[0], b[1], b[2], c[0], c[1], c[2])
    u = cross(b[0], b[1], b[2], p[0], p[1], p[2])
    s = cross(c[0], c[1], c[2], r[0], r[1], r[2])
    us = cross(u[0], u[1], u[2], s[0], s[1], s[2])
    return 0.5 * (bc[0] + us[0]), 0.5 * (bc[1] + us[1]), 0.5 * (bc[2] + us[2])
