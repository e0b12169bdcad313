"""PX4's ULog: reader, writer and what finds its records among damage."""
