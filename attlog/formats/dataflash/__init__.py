"""ArduPilot's DataFlash logs, binary and text: recognised, read and written."""
