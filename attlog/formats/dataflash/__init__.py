"""ArduPilot's DataFlash, binary and text: reader, writer, clock, units."""
