"""Finished runs → tables and figures."""
