"""ArduPilot: which record means what, in every era, and which setting logs it."""
