"""Records as they were measured: files, channels, units, faults."""
