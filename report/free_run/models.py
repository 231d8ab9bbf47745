"""What each model of the leaderboard is told of the structure, and whether it contains the truth.

Fixed statements, no results: what a small error shows depends on them.
"""

from __future__ import annotations

from report.free_run.rows import SYSTEMS, Row

TOLD = {
    "element_network": (
        "where masses sit and that forces act between two of them or against the ground; that a "
        "law is made of a spring, a damper, a cubic spring, hinges and hysteretic units. It learns "
        "masses and laws. On these three systems that *contains* the truth: parametric "
        "identification"
    ),
    "element_network_accelerations": (
        "as `element_network`, and like it contains the truth; it looks at accelerations and "
        "forces alone, never at displacements or velocities"
    ),
    "element_network_tanh": (
        "as `element_network`, with smooth springs (tanh) instead of hinges and cubic ones: it can "
        "only approximate gaps and cubic springs, so on bilinear and polynomial its figures are "
        "nonparametric. Its hysteretic units still contain Bouc–Wen"
    ),
    "latent_hysteresis_network": (
        "no topology: modes, directions of deformation and laws are learned, nonparametric as a "
        "model of the structure. Its laws are of the same kind as those of `element_network`, so "
        "the truth could be found in its directions, of which there are more than elements"
    ),
    "vwnn_forward": (
        "that restoring forces are odd and arise between two masses or against the ground; it "
        "learns from accelerations and forces alone, nonparametric"
    ),
    "gru": "nothing: a black box from forces and the initial state to the motion",
    "lstm": "nothing: a black box from forces and the initial state to the motion",
    "neural_state_space": "nothing but that a linear system is a good start: a black box beside it",
    "linear": "that forces are linear in displacement and velocity",
    "vwnn": "nothing: the network of the paper, one step ahead in training, fed its own estimates",
    "residual_mlp": "that a linear system is a good start; trained one step ahead",
    "global_mlp": "that the acceleration depends on x, ẋ and f alone, with no memory; trained one "
    "step ahead",
} | dict.fromkeys(
    ("power_series_residual", "power_series_restoring_force", "chebyshev_restoring_force"),
    "that each modal force is a polynomial of its own mode's displacement and velocity, with no "
    "memory; trained one step ahead",
)


def told(model: str) -> str:
    return TOLD.get(model, "")


def contains(row: Row) -> str:
    """Whether the structure's law is among those that the model can have; "" where unknown."""
    if row.system not in SYSTEMS or row.model not in TOLD:
        return ""
    if row.model in ("element_network", "element_network_accelerations"):
        return "yes"
    if row.model == "element_network_tanh":
        return "yes" if row.system == "bouc_wen" else "no"
    return "possible" if row.model == "latent_hysteresis_network" else "no"
