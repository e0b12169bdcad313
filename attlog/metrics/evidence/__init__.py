"""What several metrics need before they measure: rests, following, the common gyro bias, aiding."""
