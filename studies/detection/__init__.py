"""Change detectors: delays and false alarms."""
