"""A chain or all pairs of masses: both are fitted, and motion that was held back chooses.

Where nobody knows the masses of a shaken structure nor what joins them, a test of its accelerations
guesses (models/composition/topology.py), which noise misleads. The free run on held-back motion
decides.
"""

from __future__ import annotations

import math

from lightning.pytorch import Trainer
from omegaconf import DictConfig

from data.datamodule import Data
from models.fit.identification import Identification
from models.training.assemble import asks_for_topology, identification_from

OTHER = {"chain": "all", "all": "chain"}
WORDS = {"chain": "chain", "all": "all pairs"}
ENOUGH = 0.03  # relative error on held-back motion: a chain that leaves less has no rival
WORTH = 0.9  # times the error of the chain: what all pairs have to be below

Fitted = tuple[Identification, Trainer]


def with_other_topology(
    cfg: DictConfig, data: Data, module: Identification
) -> Identification | None:
    """The same model of the other topology, which becomes that of the data; None where none asks.

    No rival has a model that nothing was held back for, or a chain that leaves next to no error.
    """
    if not asks_for_topology(cfg.model, data) or data.topology is None:
        return None
    error = _error(module)
    if error is None or (data.topology == "chain" and error < ENOUGH):
        return None
    data.topology = OTHER[data.topology]
    return identification_from(cfg, data)


def preferred(data: Data, first: Fitted, rival: Fitted) -> Fitted:
    """The better of two on held-back motion, all pairs only if clearly; it names the other.

    The topology of the data becomes that of the preferred.
    """
    names = [OTHER[str(data.topology)], str(data.topology)]
    fits = dict(zip(names, (first, rival), strict=True))
    errors = {name: _error(module) for name, (module, _) in fits.items()}
    chain, pairs = (errors[name] or math.inf for name in ("chain", "all"))
    data.topology = "all" if pairs < WORTH * chain else "chain"
    module, trainer = fits[data.topology]
    told = (f"{WORDS[n]} {100.0 * (e or math.inf):.3g}" for n, e in errors.items())
    module.solution["held_out_error_by_topology_percent"] = ", ".join(told)
    module.fit_seconds = sum(one.fit_seconds for one, _ in fits.values())
    return module, trainer


def _error(module: Identification) -> float | None:
    """Relative error on held-back motion; None where none was judged."""
    loss = module.objective.held_back_loss
    return None if loss is None else math.sqrt(loss)
