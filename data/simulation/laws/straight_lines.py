"""Laws of straight lines: an envelope through N points on either side, and paths between the sides.

ρ = r/k is a length. Of the parameters p, p[1] to p[N] are the places Y of the points of the front,
then come S₂ to S_N, their forces over k Y₁; those of the back begin at p[B]: its places, then its
S₁ to S_N. The envelope goes on where it rose last, else level.

A path has three lines, from where an element turned round to where it aims. Points 0 to 3 of it
stand in the memory, m[2] to m[9]: u and ρ of each, in the direction of the motion, u = ±y. Branch 0
is at rest; then come the N + 1 lines of the envelope and the three of a path, odd ones forward.
"""

# annotations are no strings here: those of a law's constructor are read in the file of the law

from dataclasses import dataclass, fields
from typing import ClassVar

from data.simulation.laws.branches import way_of
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Element

AT_REST = 1e-4  # of Y₁: the element has no direction yet


@dataclass(frozen=True, kw_only=True)
class StraightLines(Element):
    """An element of such a law; fields of a back of its own begin with back_."""

    PLACES: ClassVar[tuple[str, ...]]  # fields of Y
    SHARES: ClassVar[tuple[str, ...]] = ()  # further fields that a back of its own has
    by_path = True
    fibres = ("stiffness",)

    def __post_init__(self) -> None:
        super().__post_init__()
        for back in self.sides:
            self._require_side(back)

    def _require_side(self, back: str) -> None:
        """Check that every point of an envelope lies beyond the one before."""
        names = [f"{back}{name}" for name in self.PLACES]
        places = [getattr(self, name) for name in names]
        if sorted(set(places)) != places:
            raise ValueError(
                f"{type(self).__name__}: {', '.join(names)} = {places} m must grow from one to "
                "the next"
            )

    @property
    def sides(self) -> list[str]:
        """What the fields of each side begin with; one side, where both are alike."""
        return ["", "back_"] if hasattr(self, "back_yield_displacement") else [""]

    @property
    def parameters(self) -> tuple[float, ...]:
        names = [f.name for f in fields(self) if f.name != "between"]
        own = [float(getattr(self, name)) for name in names if not name.startswith("back_")]
        back = self.sides[-1]
        places, shares = (
            [getattr(self, f"{back}{name}") for name in of_back]
            for of_back in (self.PLACES, self.SHARES)
        )
        return (*own, *places, *self._strengths(back), *shares)

    def _strengths(self, back: str) -> list[float]:
        """S of all points of a side."""
        first = getattr(self, f"{back}strength_1") if back else 1.0
        more = range(2, len(self.PLACES) + 1)
        return [first, *(getattr(self, f"{back}strength_{i}") for i in more)]

    def points(self, back: str, side: float) -> list[float]:
        """Force [N] and place [m] of every point of a side, as OpenSees takes them."""
        force = self.stiffness * self.yield_displacement  # type: ignore[attr-defined]
        places = [getattr(self, f"{back}{name}") for name in self.PLACES]
        pairs = zip(self._strengths(back), places, strict=True)
        return [side * number for s, y in pairs for number in (force * s, y)]

    def strengths(self) -> tuple[float, float] | None:
        force = self.points("", 1.0)[0]
        return None if len(self.sides) == 1 else (force, -self.points("back_", -1.0)[0])


@inlined
def place(p, N, B, side, i):
    """Y of a point of the envelope of a side, i = 0 (the origin) to N."""
    if i == 0:
        return 0.0
    return p[i] if side > 0.0 else p[B - 1 + i]


@inlined
def height(p, N, B, side, i):
    """ρ there."""
    if i == 0:
        return 0.0
    if side > 0.0:
        return p[1] if i == 1 else p[N - 1 + i] * p[1]
    return p[B + N - 1 + i] * p[1]


@inlined
def slope(p, N, B, side, line):
    """Of ρ on a line of the envelope, 0 to N − 1."""
    rise = height(p, N, B, side, line + 1) - height(p, N, B, side, line)
    return rise / (place(p, N, B, side, line + 1) - place(p, N, B, side, line))


@inlined
def line_at(p, N, B, side, u):
    """The line of the envelope of a side at u > 0, 0 to N."""
    for line in range(N):
        if u < place(p, N, B, side, line + 1):
            return line
    return N


@inlined
def envelope(p, N, B, side, line, u):
    """ρ of a line of the envelope of a side at u."""
    if line == N:
        level = max(slope(p, N, B, side, N - 1), 0.0)
        return height(p, N, B, side, N) + level * (u - place(p, N, B, side, N))
    rise = slope(p, N, B, side, line) * (u - place(p, N, B, side, line))
    return height(p, N, B, side, line) + rise


@inlined
def area(p, N, B, side):
    """Of ρ under the envelope of a side, up to its last point."""
    total = 0.0
    for i in range(N):
        rho = height(p, N, B, side, i) + height(p, N, B, side, i + 1)
        total += 0.5 * rho * (place(p, N, B, side, i + 1) - place(p, N, B, side, i))
    return total


@inlined
def first_of_path(N):
    """The branch of the first line of a path forward."""
    return 2 * N + 3


@inlined
def end_of(m, line):
    """u at the end of a line of the path, 0 to 2."""
    return m[4 + 2 * line]


@inlined
def on_line(m, line, u):
    """ρ of a line of the path at u; where the line has no length, that of its end."""
    if line == 0:
        u0, f0, u1, f1 = m[2], m[3], m[4], m[5]
    elif line == 1:
        u0, f0, u1, f1 = m[4], m[5], m[6], m[7]
    else:
        u0, f0, u1, f1 = m[6], m[7], m[8], m[9]
    if u1 <= u0:
        return f1
    return f0 + (f1 - f0) / (u1 - u0) * (u - u0)


@inlined
def shape(p, N, B, m, branch, y, left):
    """ρ of a branch at y, where a share of the envelope is left."""
    if branch == 0:
        return y * slope(p, N, B, y, 0)
    side = way_of(branch)
    if branch < first_of_path(N):
        return side * left * envelope(p, N, B, side, (branch - 1) // 2, side * y)
    return side * on_line(m, (branch - first_of_path(N)) // 2, side * y)


@inlined
def margin_of(p, N, B, m, branch, y, ydot, rest):
    """`margin` of such a law, at rest within |y| < rest."""
    if branch == 0:
        return rest - abs(y)
    side = way_of(branch)
    if branch < first_of_path(N):
        line = (branch - 1) // 2
        if line == N:
            return side * ydot
        return min(side * ydot, place(p, N, B, side, line + 1) - side * y)
    return min(side * ydot, end_of(m, (branch - first_of_path(N)) // 2) - side * y)


@inlined
def next_line(p, N, B, m, branch, y):
    """The branch past the end of another in its direction; 0 where the element turns round."""
    if branch == 0:
        return 1 if y > 0.0 else 2
    side = way_of(branch)
    if branch < first_of_path(N):
        line = (branch - 1) // 2
        if line < N and side * y > place(p, N, B, side, line + 1):
            return branch + 2
    else:
        line = (branch - first_of_path(N)) // 2
        if side * y > end_of(m, line):
            if line < 2:
                return branch + 2
            return (1 if side > 0.0 else 2) + 2 * line_at(p, N, B, side, side * y)
    return 0
