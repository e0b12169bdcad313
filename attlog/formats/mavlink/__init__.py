"""MAVLink telemetry, tlogs and raw captures: recognised, read and written."""
