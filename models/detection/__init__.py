"""Change detectors: what watches an estimator and raises an alarm when the structure changes."""
