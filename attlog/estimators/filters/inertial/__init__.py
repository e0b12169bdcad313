"""Parts of the inertial-magnetic error-state filter: state layout, start and rest, magnetometer, backward pass."""
