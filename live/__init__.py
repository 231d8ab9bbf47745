"""An on-line model beside a shaking structure: `python -m live`."""
