"""PX4's ULog: recognised, read (also damaged or encrypted), and written."""
