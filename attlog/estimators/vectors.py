"""The vector helpers under the name that filters written for the first version import."""

from attlog.estimators.engine.vectors import (
    GRAVITY,
    down,
    field_error,
    gravity_error,
    half_angle,
    turn,
    turn_vector_back,
    turned_back,
)

__all__ = ["GRAVITY", "down", "field_error", "gravity_error", "half_angle", "turn", "turn_vector_back", "turned_back"]
