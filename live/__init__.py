"""Live models beside a shaking structure: `python -m live`."""
