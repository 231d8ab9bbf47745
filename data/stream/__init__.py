"""Samples one by one: lines of text, clocks, sources."""
