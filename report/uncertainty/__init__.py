"""How sure a finished run is: intervals, profiles and samples of its parameters, asked for."""
