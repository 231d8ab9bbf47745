"""A model leaves the house: C, FMU, OpenSees, JSON."""
