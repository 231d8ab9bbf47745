"""Compositions of a linear core and elements, simulated as a whole with their derivatives."""
