"""Four papers run again: each a list of claims with a verdict and its numbers."""


# Fan: 12-state EKF against a complementary filter.
