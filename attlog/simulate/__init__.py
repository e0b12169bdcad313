"""Simulated quadrotor flights, and the logs that an autopilot would have written of them."""
