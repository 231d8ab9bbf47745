"""Everything around a run and a sweep: config, folder, progress, search."""
