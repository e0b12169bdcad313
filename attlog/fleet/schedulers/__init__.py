"""Who works on which log: this machine or a cluster."""
