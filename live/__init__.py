"""Live models of a shaking structure: `python -m live`."""
