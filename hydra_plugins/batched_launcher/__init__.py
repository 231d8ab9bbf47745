"""Hydra's name for runner/side_by_side.py: launchers have to live in hydra_plugins."""
