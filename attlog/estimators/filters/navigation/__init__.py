"""The model that ``eskf`` and ``smoother`` share: inertial navigation with GNSS, barometer, magnetometer and rest."""
