"""PX4's ULog: reader, also of damaged or encrypted logs, and writer."""
