"""ArduPilot's DataFlash logs: reader of binary and text logs, writer of binary ones."""
