"""What four papers found, run again: one file per paper, each a list of claims with a verdict and its numbers."""


# Lyu: a complementary filter with variable integral.

# Huang: Mahony's filter on the rotation matrix, nested PI-PID.

# Xu: the gain of Mahony's filter on Pixhawk logs.

# Fan: 12-state EKF against a complementary filter.
