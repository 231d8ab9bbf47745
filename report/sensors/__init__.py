"""Which floors should have a sensor, by the expected intervals of the drifts of all storeys."""
