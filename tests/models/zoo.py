"""Every estimator of conf/model but those of element tests, small enough for a second."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from omegaconf import DictConfig

from data.sample import Sensors
from models.estimator import Estimator
from models.fir import FIR
from models.fit.trainable import Trainable
from models.linear_motion import LinearMotion
from models.linear_state_space import LinearStateSpace
from models.modal_network import ModalNetwork
from models.online.adaptive import Online
from models.vwnn import VWNN
from models.vwnn_forward import ForwardVWNN
from runner.config.compose import CONF, EARLIER, composed
from tests.experiments import changed, class_of, estimator_from

DT = 0.01
NOTHING_CHOSEN = {"prior": 1e-6, "force_memory": False, "unsymmetric": False}
SMALL_BRANCH = {"ramps": 2, "bends": 1, "law_starts": 1, **NOTHING_CHOSEN}
SMALLER = {  # what a class is built with here, so that it is identified in a second
    "models.ModalPolynomial": {"order": 3},
    "models.Recurrent": {"hidden": 4},
    "models.NeuralStateSpace": {"memory": 2, "hidden": 4, "past": 3},
    "models.ForwardVWNN": {"refinements": 1},
    "models.ElementNetwork": {"hinges": 1, "units": 1},
    "models.ElementNetworkBranch": SMALL_BRANCH,
    "models.ElementNetworkNamed": {"elements": "chain", "laws": ["SelfCentering"]},
    "models.NamedElement": {"laws": ["SelfCentering"]},
    "models.BranchElement": SMALL_BRANCH,
    "models.LatentHysteresisNetwork": {"elements": 3, "hinges": 1, "units": 1},
    "models.ModalNetwork": {"modes": 3, "elements": 0, "iterations": 3},
}
NO_STRUCTURE = (  # elements alone
    "models.BranchElement",
    "models.HystereticElement",
    "models.NamedElement",
    "models.PrandtlIshlinskii",
    "models.RestoringForceSurface",
)


def class_name(cfg: DictConfig) -> str:
    """The class that a model's config is built of, that of its laws, as configs would name it."""
    return f"models.{class_of(cfg).__name__}"


def build(cfg: DictConfig, dofs: int, inputs: int, dt: float) -> Estimator:
    smaller = {k: v for k, v in SMALLER.get(class_name(cfg), {}).items() if k in cfg}
    return estimator_from(changed(cfg, smaller), Sensors(dt, dofs, inputs))


def zoo() -> tuple[dict[str, Callable[..., Estimator]], dict[str, Callable[..., Estimator]]]:
    """name → (dofs, inputs, dt) → estimator, of conf/model and earlier names; element tests."""
    paths = (*(CONF / "model").glob("*.yaml"), *(EARLIER / "model").glob("*.yaml"))
    names = sorted(path.stem for path in paths)
    models = {name: composed(f"model={name}").model for name in names}
    alone = {name for name, cfg in models.items() if class_name(cfg) in NO_STRUCTURE}
    made = {name: partial(build, cfg) for name, cfg in models.items()}
    structures = {name: make for name, make in made.items() if name not in alone}
    return structures, {name: made[name] for name in sorted(alone - {"hysteretic_element"})}


STRUCTURES, ELEMENT_TESTS = zoo()
ZOO = {**STRUCTURES, "vwnn_unfiltered": partial(VWNN, unfiltered_excitation=True)}
KINDS = {name: make(3, 3, DT) for name, make in ZOO.items()}
ADAPTING = [name for name, kind in KINDS.items() if isinstance(kind, Online)]  # while they estimate
TRAINED = [name for name, kind in KINDS.items() if isinstance(kind, Trainable)]
OF_EXCITATION = FIR | ForwardVWNN | LinearMotion | LinearStateSpace | ModalNetwork
SIMULATORS = [  # what they estimate is a simulation, or they are identified by one
    name
    for name, kind in KINDS.items()
    if isinstance(kind, OF_EXCITATION) or (name in TRAINED and "x" not in kind.reads)
]
ESTIMATORS = {  # their closed form is all there is to identify
    name: make for name, make in ZOO.items() if name not in (*ADAPTING, *TRAINED, *SIMULATORS)
}
SOLVED = [name for name in ESTIMATORS if "f" in KINDS[name].reads]
SEE_FORCE = [*SOLVED, *SIMULATORS, *ADAPTING]
