"""Laws that engineers use, whose parameters are learned: which there are, how one is fitted."""
