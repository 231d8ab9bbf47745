"""Restoring-force laws: one law, one file, and a line of the list below (docs/adding.md).

Every law is written branch by branch (elastic, yielded, gap closed, ...), and is smooth within a
branch; the integrator finds the instants at which a branch ends. With the deformation y [m], its
velocity ẏ [m/s] and a state z, a law is three small compiled functions of one element at one
instant, and a dataclass of its parameters:

    force(p, m, branch, y, ẏ, z, work) → r [N], ż   work = ∫ r ẏ dt, the energy it took up [J]
    margin(p, m, branch, y, ẏ, z)                   ≥ 0 while the branch holds, < 0 past its end
    next_branch(p, m, branch, y, ẏ, z) → branch, z, m   what holds past that end

p are the parameters, m is what the law remembers of its past: `next_branch` alone changes it, so
that it stays as it is along a branch. It holds no force, so that a loss of fibres leaves it as it
is.
Branch 0 is the branch at rest, where m is zero.
"""

INLINED = {  # of the paper: file → classes; compiled into the integrator's loop
    "bilinear": ["Bilinear"],
    "limited_slip": ["LimitedSlip"],
    "polynomial": ["Polynomial"],
    "bouc_wen": ["BoucWen"],
}
CALLED = {  # all others, called by it
    "menegotto_pinto": ["MenegottoPinto"],
    "self_centering": ["SelfCentering"],
    "slack_brace": ["SlackBrace", "Stop"],
    "friction_pendulum": ["FrictionPendulum"],
    "takeda": ["Takeda"],
    "baber_noori": ["BaberNoori"],
    "pinching4": ["Pinching4", "UnevenPinching4"],
    "hysteretic": ["Hysteretic", "UnevenHysteretic"],
    "power_damper": ["PowerDamper"],
    "maxwell": ["Maxwell"],
    "tanh_damper": ["TanhDamper"],
    "nailed_wall": ["NailedWall"],
    "peak_oriented": ["PeakOriented"],
    "concrete": ["Concrete"],
    "chaboche": ["Chaboche"],
}
FILES = INLINED | CALLED
NUMBERS = {file: number for number, file in enumerate(FILES)}  # by which compiled code knows a law
