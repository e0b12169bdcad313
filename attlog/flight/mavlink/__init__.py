"""MAVLink telemetry of either firmware: which message means what."""
