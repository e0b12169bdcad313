"""PX4's ULog: how it is recognised, read (also damaged), written, timed, and compared with pyulog."""
