"""A command line → the config of a run: its choices and settings, their types, its identity."""
