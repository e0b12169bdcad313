"""Xu: the gain of Mahony's filter on Pixhawk logs."""
