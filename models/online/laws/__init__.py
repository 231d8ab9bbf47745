"""Adaptation laws of on-line models, each in PyTorch to read and compiled to run."""
