"""Lyu: a complementary filter with variable integral."""
