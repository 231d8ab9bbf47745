"""Optimizers that fit the free parameters of any estimator: one method a file.

`solve(problem)` improves the parameters on one batch and returns the loss after every accepted
iteration (Adam: before each step); `finished` says that going on is of no use.
"""
