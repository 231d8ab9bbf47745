"""Structures simulated: laws, excitation, motion, sensors."""
