"""Gains found on some logs and judged on others."""
