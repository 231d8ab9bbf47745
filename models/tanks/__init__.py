"""Tanks in a row: their free run and its derivatives, compiled; training from many draws."""
