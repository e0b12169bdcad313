"""Figure behind a finding, an event or a check: what to look at to see it."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

# Figures, the best first, and the checks, angles and kinds of findings and events that they show. Ids are those of the
# catalogue; ``parameters`` is the table.
SHOWS: tuple[tuple[str, str], ...] = (
    ("motors", "motor motor_output thrust propellers hover motor_thrust motor_outputs thrust_reserve yaw_response"),
    ("motors", "hover_thrust yaw_bias uneven_motors esc_load motor_no_thrust motor_off motor_frozen motors_off"),
    ("motors", "no_thrust_left yaw_backwards"),
    ("rates", "control rate_tracking oscillation"),
    ("battery", "battery supply board_supply brownout"),
    ("load rates attitude", "main_loop processor"),
    ("rates attitude", "gaps jitter rate"),
    ("vibration spectrum acceleration", "vibration vibration_level"),
    ("acceleration vibration", "clipping"),
    ("spectrum vibration", "gyro_spectrum notch filter_delay delay"),
    ("heights attitude", "vertical_force gnss_height barometer barometer_noise ev_60 wreck_moved"),
    ("heights attitude", "crash impact hard_landing landing liftoff ends_in_air"),
    ("rates bias", "gyro gyro_range gyro_dead gyro_spikes frozen_gyro frozen_sensors imu_delay accelerometer_delay"),
    ("bias rates", "gyro_bias gyro_bias_step sensor_switch"),
    ("temperature", "gyro_temperature accelerometer_temperature"),
    (
        "gravity vibration",
        "accelerometer accelerometer_offset accelerometer_rest accelerometer_dead accelerometer_axes",
    ),
    ("gravity attitude", "force_axes onboard_acc_bias imu_instances gravity_in_flight gravity_kept gravity_direction"),
    ("attitude", "attitude tilt mounting reset realigned gyro_scale gyro_against_attitude trim coverage second_source"),
    ("attitude", "attitude_jumps overturn tumble crash_check"),
    ("difference attitude", "onboard_against_truth onboard_against_smoother"),
    ("headings attitude track", "heading heading_by_gnss"),
    ("interference compass field", "compass_motors"),
    ("compass field attitude", "compass field field_size field_against_attitude soft_iron compass_iron compass_dead"),
    ("compass field attitude", "compass_offset compass_turn compass_orientation compass_choice compass_switch"),
    ("compass field attitude", "declination declination_set magnetometer_delay mag_only_offsets mag_dead"),
    ("reception track", "gnss gnss_quality gnss_interference gnss_lost"),
    ("track reception", "gnss_jumps gnss_jump gnss_delay"),
    ("ratios attitude", "estimator innovations lanes aid_rejected lane_switch"),
    ("sticks attitude", "full_stick radio_lost"),
    ("parameters", "unsafe_settings parameter_changed"),
    ("strip", "armed disarmed"),
)
# Figures by a word of the report, for kinds that hold anything that the autopilot reports.
REPORTED = ("failsafe", "message", "device_error", "sensor_fault", "arming_refused", "first_cause")
WORDS: tuple[tuple[str, str], ...] = (
    ("battery", "battery voltage power brownout"),
    ("sticks", "radio rc throttle stick sticks manual"),
    ("reception track", "gnss gps"),
    ("compass field attitude", "compass mag magnetometer heading"),
    ("ratios attitude", "ekf ekf2 ekf3 estimator position"),
    ("gravity vibration", "accelerometer accel accels"),
    ("rates", "gyro gyros"),
    ("heights", "barometer baro altitude height terrain rangefinder"),
    ("motors", "motor motors esc thrust kill termination"),
    ("track", "fence geofence home"),
    ("load", "link connection logging logger cpu"),
)
# What the time alone shows.
TIMED = ("attitude", "heights", "strip")
# Checks that compare any two sensors: what is wrong with which stands in the kind of the finding.
OF_ANY_SENSOR = ("imu_instances",)
FIGURES_OF = {name: figures.split() for figures, names in SHOWS for name in names.split()}
FIGURES_OF_WORD = {word: figures.split() for figures, words in WORDS for word in words.split()}


def figure_behind(kind: str, about: str, text: str, timed: bool, present: Collection[str]) -> str:
    """Return the id of the figure that shows a finding, event or check, empty if none does.

    ``about``: the check or angle; ``text``: its sentence; ``present``: ids on the page. What has a time (``timed``) is
    shown by the attitude at least.
    """
    wanted = list(FIGURES_OF.get(kind if about in OF_ANY_SENSOR else about, ()))
    if kind in REPORTED:
        wanted += [name for word in re.findall(r"\w+", text.lower()) for name in FIGURES_OF_WORD.get(word, ())]
    wanted += [*FIGURES_OF.get(kind, ()), *(TIMED if timed else ())]
    return next((name for name in wanted if name in present), "")


def view_named(views: Sequence[str], sensor: str, text: str) -> int | None:
    """Return the number of the view of a sensor, else of the first sensor in a text; None if it names none."""
    if len(views) < 2:
        return None
    if sensor in views:
        return views.index(sensor)
    places = {i: re.search(rf"(?<![\w.:]){re.escape(name)}(?![\w:]|\.\w)", text) for i, name in enumerate(views)}
    found = {match.start(): i for i, match in places.items() if match}
    return found[min(found)] if found else None
