"""ArduPilot's DataFlash logs, binary and text: recognised, read, written, timed, and compared with pymavlink."""
