"""Which composite networks run as models/composition/simulate.py has it."""

from __future__ import annotations

from models.composition.composite import Composite
from models.composition.trace import traced
from models.estimator import Estimator


def plain_composite(estimator: Estimator) -> Composite:
    """The estimator, where its free run is that of its composition.

    Raises ValueError for all others: networks of branch laws, imposed motions, other estimators.
    """
    own = isinstance(estimator, Composite) and type(estimator).free_run is Composite.free_run
    if not isinstance(estimator, Composite) or not own or type(estimator).traced is not traced:
        raise ValueError(
            f"{type(estimator).__name__} has another equation than an element network; choose "
            "to=c or to=fmu"
        )
    return estimator
