"""A quadrotor, its sensors and its controller: flights with known truth, and the logs they would have written."""
