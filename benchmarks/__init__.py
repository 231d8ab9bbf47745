"""Peers and scaling, run by hand; never imported by the project."""
