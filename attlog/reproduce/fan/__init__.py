"""Fan: 12-state EKF against a complementary filter."""
