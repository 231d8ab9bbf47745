"""Candidates for a structure compared: topologies and laws."""
