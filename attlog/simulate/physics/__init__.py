"""The body in the air: motion, wind, environment."""
