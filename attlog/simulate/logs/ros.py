"""A flight as a bag that a companion computer records: PX4's topics, and the pose of a motion capture.

The pose is the simulated truth in the axes of a laboratory (forward-left-up in east-north-up, turned by a heading), on
the recorder's clock: a truth to be brought, as ``--truth /mocap/pose``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from attlog.base import rotation
from attlog.formats import Recording
from attlog.simulate.flight import Flight
from attlog.simulate.logs import px4
from attlog.simulate.logs.records import every, micros, since_start

TOPIC, RATE_HZ = "/mocap/pose", 100.0
NOISE_DEG, TURNED_DEG = 0.05, 30.0
"""What motion capture adds to each attitude, and how its first axis lies to east."""


def left_out(topic: str) -> bool:
    """Whether a topic is not in the bag: truth that only a simulator logs, and nested messages."""
    return "groundtruth" in topic or topic == "esc_status"


def recording(flight: Flight) -> Recording:
    """The flight as the messages of a bag; without the truth that only a simulator logs."""
    made = px4.recording(flight)
    messages = {key: columns for key, columns in made.messages.items() if not left_out(key[0])}
    truth = since_start(flight).truth
    k = every(truth.t, RATE_HZ)
    noise = np.radians(NOISE_DEG) * np.random.default_rng(flight.seed).standard_normal((len(k), 3))
    world = rotation.multiply(rotation.from_rotvec([0.0, 0.0, np.radians(TURNED_DEG)]), rotation.ENU)
    body = rotation.multiply(truth.q[k], rotation.from_rotvec(noise))
    q = rotation.multiply(rotation.multiply(world, body), rotation.FLU)
    messages[TOPIC, 0] = {"timestamp": micros(truth.t[k]), "q": q, "p": rotation.rotate(world, truth.p[k])}
    return replace(made, messages=messages, params=(), texts=(), info={}, layouts={})
