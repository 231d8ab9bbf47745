"""Sliders in series with nonlinear springs: the stop operator and the search for their widths."""
