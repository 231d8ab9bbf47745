"""On-line VWNNs: time per sample, hours at the pace of the data."""
