"""How does a structure move, and what do its sensors see? Elements, excitations, motions, noise."""
