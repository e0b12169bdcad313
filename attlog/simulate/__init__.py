"""A quadrotor, its sensors and its controller: flights with known truth, and the logs they would have written."""


# What flies the simulated vehicle.

# The body in the air: motion, wind, environment.

# What is simulated: scenarios, their files, their errors.

# One file per sensor: what it measures of a motion, with its errors.
