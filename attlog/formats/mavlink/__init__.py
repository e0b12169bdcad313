"""MAVLink telemetry: reader of tlogs and raw captures, writer of tlogs."""
