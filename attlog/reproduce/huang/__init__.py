"""Huang: Mahony's filter on the rotation matrix, nested PI-PID."""
