"""What autopilots log of vibration, and how they filter it."""
