"""Pieces of branches that several laws share: sides in bits, the elastoplastic slider.

A side is stored in two bits: 00 neither, 01 the positive, 10 the negative.
"""

from __future__ import annotations

from data.simulation.laws.compiling import inlined

# A law of one branch, which never ends.


@inlined
def margin(p, m, branch, y, ydot, z):
    return 1.0


@inlined
def next_branch(p, m, branch, y, ydot, z):
    return 0, z, m


# Sides.


@inlined
def side(branch):
    return (branch & 1) - ((branch >> 1) & 1)


@inlined
def bits(side):
    return 1 if side > 0 else (2 if side < 0 else 0)


@inlined
def way_of(branch):
    """1 of an odd branch, −1 of an even one, where a law's branches come in such pairs."""
    return 1.0 if branch & 1 else -1.0


# Elastoplastic slider: sticks (0) while |z| < z_y, slides (+1, −1) at z = ±z_y until the velocity
# turns round.


@inlined
def slider_margin(sliding, yield_displacement, ydot, z):
    if sliding != 0:
        return sliding * ydot
    return yield_displacement - abs(z)


@inlined
def slider_next(sliding, yield_displacement, ydot, z):
    """Side after the end of a branch, and z exactly on the yield surface if it got there."""
    if slider_margin(sliding, yield_displacement, ydot, z) >= 0.0:
        return sliding, z
    if sliding != 0:
        return 0, z
    return (1, yield_displacement) if z > 0.0 else (-1, -yield_displacement)
