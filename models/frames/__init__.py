"""The moment frame: hinges of steel, columns and beams under a motion and in free run, the fit."""
