"""Reader of ArduPilot logs of all versions."""
