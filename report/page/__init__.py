"""A finished run, or a search for one, as one HTML file that can be mailed."""
