"""Adaptation laws of on-line models: settings, and a compiled step."""
