"""Where training begins: linear structures found from motions, in ways that do not refuse."""
