"""MAVLink telemetry, tlogs and raw captures: recognised, read, written, timed, and compared with pymavlink."""
