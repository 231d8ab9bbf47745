"""Adaptation laws of on-line models, each in PyTorch and compiled."""
