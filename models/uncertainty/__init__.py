"""How sure a fit is: intervals of parameters, bands of free runs, what the residual still holds."""
