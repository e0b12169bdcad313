"""What flies the simulated vehicle."""
