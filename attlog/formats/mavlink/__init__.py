"""MAVLink telemetry (tlog, raw captures): reader, writer, index of packets."""
