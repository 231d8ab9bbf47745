"""What a search minimises: the error on the part of the training motion that was held back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from models.training.identification import HELD_BACK


def validation_error(metrics: Mapping[str, Any]) -> float:
    """Eq. 21 one step ahead in percent, against the measured signal; infinite where it overflowed.

    Raises ValueError for a run that held nothing back.
    """
    if HELD_BACK not in metrics:
        raise ValueError("the run held nothing back to be judged on; set data.validation=0.2")
    error = metrics[HELD_BACK]["relative_rms_percent"]
    return math.inf if error is None else error
