"""One element under an imposed motion: what its models share, and one front for their laws.

r = law(s, ṡ)   of units: hysteretic_element.py, branches: branch_element.py, by a name:
named_element.py, sliders: prandtl_ishlinskii.py, a surface: restoring_force_surface.py
"""

from __future__ import annotations

from data.record import Record
from models.estimator import ByLaws, Estimator

REMEDY = (  # where a record is no element test
    "give it columns s1, s_dot1 and r1 (data.quantity=force), or take model=element_network for "
    "the motion of a structure, with model/reads=accelerations if these alone are measured"
)


NIL = (
    "a deformation, its rate or a force is zero throughout: leave it out; of a test without rates "
    "take model=element_test model.laws=units, or say data.dt, by which they are slopes"
)


class ElementTest(ByLaws, Estimator):
    """Forces r (…, T, E) from imposed deformations s and rates ṡ, the excitation [s, ṡ].

    laws: "units" makes a `HystereticElement`; "branch" a `BranchElement`; "named", or a list of
    names, a `NamedElement`, each with settings of its own.
    """

    takes_other_inputs = False
    reading_other_inputs = "model=element_test model.laws=units"

    def require_one_element(self) -> None:
        """Raise ValueError unless there are one force and the two channels of its element."""
        if (self.dofs, self.inputs) != (1, 2):
            raise ValueError(
                f"{type(self).__name__} takes one force r1 under a deformation s1 and its rate "
                f"s_dot1; here are {self.dofs} responses and {self.inputs} excitations: {REMEDY}"
            )

    def require_force(self, record: Record) -> None:
        """Raise ValueError for a record that holds no force of an element."""
        if record.quantity != "force":
            raise ValueError(
                f"{type(self).__name__} describes the force of an element test; the record holds "
                f"{record.quantity}: {REMEDY}"
            )
