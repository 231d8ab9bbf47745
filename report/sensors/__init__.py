"""Which floors should have a sensor, by what it would tell of the drifts of all storeys."""
