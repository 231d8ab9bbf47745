"""A command line → its config; every choice there is, and help on all of them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from shutil import get_terminal_size
from textwrap import TextWrapper
from typing import Any

from hydra import compose, initialize_config_dir
from hydra._internal import defaults_list
from hydra._internal.hydra import Hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.core.plugins import Plugins
from hydra.core.singleton import Singleton
from hydra.core.utils import JobRuntime
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from data.annotations import shown
from data.arguments import print_any_text
from runner.config.identity import digest, run_name

CONF = Path(__file__).parents[2] / "conf"
EARLIER = CONF / "earlier"  # names of choices that are settings of others; not in the help
FULL_ERROR = "HYDRA_FULL_ERROR"  # lets Hydra raise
SHARED = "shared"  # by the experiments of a folder
GROUPS = (
    *("system", "excitation", "damage", "scenario", "data", "model"),
    *("solver", "objective", "adaptation", "baselines", "trainer", "logger", "experiment"),
)
NESTED = ("model.laws", "model.reads")  # groups of choices inside of one
MODELS = {  # what they are for; the help lists any other below these
    "the paper's methods": (
        *("residual_mlp", "global_mlp", "vwnn", "power_series_residual"),
        *("power_series_restoring_force", "chebyshev_restoring_force"),
    ),
    "plain opponents": (
        *("fir", "linear_state_space", "linear_motion", "linear", "linear_modes"),
        *("two_point", "last_value", "filtered_extrapolation"),
    ),
    "simulate structures": (
        *("element_network", "latent_hysteresis_network", "modal_network"),
        *("neural_state_space", "gru", "vwnn_forward"),
    ),
    "one element under an imposed motion": (
        *("element_test", "prandtl_ishlinskii", "restoring_force_surface"),
    ),
    "on line": ("online_vwnn", "online_linear", "online_polynomial"),
}
NAMED = (  # mappings whose keys are the user's
    *("data.channels.", "data.units.", "data.delay.", "priors.", "model.priors", "model.rows"),
    *("excitation.channels.", "excitation.units.", "excitation.delay.", "limits."),
    "model.ties",  # models that have none say so themselves
)
EXAMPLES = {
    "train": """Identify a structure: simulate it, fit a model, score it on unseen motion.

  python train.py model=vwnn system=bilinear
  python train.py model=vwnn system=polynomial scenario=noisy seed=4
  python train.py -m model=vwnn,linear system=bilinear,bouc_wen seed=0,1
  python train.py -m hydra/launcher=joblib seed=0,1,2,3       on all cores
  python train.py data=measured data.path=record.csv         your own record

Common keys: seed, data.dt [s], data.duration [s], data.train_records,
data.test_records, model.cutoff [rad/s], trainer.accelerator, hydra.run.dir.
All of them: python train.py --cfg job""",
    "evaluate": """One finished run scored again; or many runs compared.

  python evaluate.py run=FOLDER                  from its config and checkpoint
  python evaluate.py run=FOLDER scenario=noisy seeds=[5,6,7]
  python evaluate.py run=FOLDER data.duration=100
  python evaluate.py run=FOLDER data.path=other.csv data.units.a=g
  python evaluate.py run=FOLDER data.path=after.csv change=true  has it changed?
  python evaluate.py run=FOLDER uncertainty=laplace   its parameters: how sure
  python evaluate.py run=FOLDER uncertainty=profile parameter=[r1.stiffness]
  python evaluate.py run=FOLDER uncertainty=smc particles=1000
  python evaluate.py runs=FOLDER output=FOLDER   results.parquet, results.csv
  python evaluate.py runs=[a,b] by=model.cutoff  compared by a choice
  python evaluate.py runs=FOLDER by=model split=free_run   the best first

The paper's tables: python -m report.paper --help""",
    "predict": """A finished run's model under another motion: what the structure would do.

  python predict.py run=FOLDER excitation.path=other.csv
  python predict.py run=FOLDER excitation.path=quake.AT2 excitation.scale=1.5
  python predict.py run=FOLDER excitation.path=quake.csv
                    excitation.units.s_ddot=g
  python predict.py run=FOLDER excitation.events=7a           of FEMA P695
  python predict.py run=FOLDER excitation.events=all excitation.scale=[0.5,1]
                    samples=200 limits.drift=0.03      fragility curves
  python predict.py run=FOLDER excitation.seed=5 excitation.duration=60

Common keys: output, excitation.units.s_ddot=g, excitation.scale,
excitation.channels.s_ddot1=COLUMN, excitation.peak [g].
All of them: python predict.py --cfg job""",
}
OTHERS = """Others, each with --help: identify.py, train.py, evaluate.py, predict.py,
python -m data.inspect | export | models.zoo
python -m report.describe | report.paper | report.sensors
Completion in bash: eval "`python train.py -sc install=bash`\""""


def help_text(program: str) -> str:
    """Examples, then each group with its choices (the config's first comment), as wide as shown."""
    own = [(group, *(n for n in NESTED if n.startswith(f"{group}."))) for group in GROUPS]
    groups = {"train": [*chain(*own)], "evaluate": ["scenario"]}.get(program, [])
    columns = min(max(get_terminal_size((80, 24)).columns, 60), 120)
    beside = TextWrapper(columns, subsequent_indent=" " * 28, break_on_hyphens=False)
    beside.break_long_words = False
    lines, usual = [EXAMPLES[program], ""], _defaults(program)
    for group in groups:
        lines.append(f"{group}=")
        for purpose, paths in _by_purpose(group):
            lines.extend([f"  {purpose}"] if purpose else [])
            for path in paths:
                mark = "(default) " if usual.get(group) == path.stem else ""
                lines.extend(beside.wrap(f"    {path.stem:<23} {mark}{_described(path)}"))
    return "\n".join([*lines, "", OTHERS])


def _by_purpose(group: str) -> Iterator[tuple[str, list[Path]]]:
    """The files of a group, those of models by what they are for."""
    found = experiments() if group == "experiment" else (CONF / _path(group)).glob("*.yaml")
    paths = sorted(found, key=lambda path: path.stem)
    known = MODELS if group == "model" else {}
    for purpose, names in known.items():
        yield purpose, [path for path in paths if path.stem in names]
    listed = {name for names in known.values() for name in names}
    if others := [path for path in paths if path.stem not in listed]:
        yield "others" if known else "", others


def _described(path: Path) -> str:
    """The first comment of a config; empty where it has none."""
    comments = [s for s in path.read_text(encoding="utf-8").splitlines() if s[:1] == "#"]
    return next((s[1:].strip() for s in comments if "@package" not in s), "")


def _path(key: str) -> str:
    return key.replace(".", "/")


def _defaults(program: str) -> dict[str, str]:
    """What each group is where nothing is said."""
    listed = DictConfig(OmegaConf.load(CONF / f"{program}.yaml")).get("defaults", [])
    chosen = [item for item in listed if isinstance(item, DictConfig)]
    return {str(group): str(choice) for item in chosen for group, choice in item.items()}


def experiments() -> list[Path]:
    """The files of all experiments, which lie in a folder for each room of the report."""
    paths = (CONF / "experiment").glob("*/*.yaml")
    return sorted(path for path in paths if path.stem != SHARED)


def placed(words: Iterable[str]) -> list[str]:
    """The same words as Hydra knows them.

    Experiments by their folder too: experiment=paper/table3 for table3. A choice inside of another
    as a group: model/laws=branch for model.laws=branch. Keys of one's own are added where a mapping
    has any: data.channels.a1=Roof.
    """
    words = list(words)
    places = {path.stem: f"{path.parent.name}/{path.stem}" for path in experiments()}
    found = []
    for key, equals, names in (_listed(word).partition("=") for word in words):
        if key == "experiment":
            names = ",".join(places.get(name, name) for name in names.split(","))
        elif key in NESTED and all(map(_choices_of(key).__contains__, names.split(","))):
            key = _path(key)
        elif key == "model.laws" and names.startswith("[") and _have_laws(words):
            found.append("model/laws=named")  # what is listed are names
        elif key.startswith(NAMED):
            key = f"++{key}"
            if key.count(".") > 1 and not can_be_read(f"{key}={names}"):  # m/s^2, or Base (g's)
                names = "'" + names.replace("'", "\\'") + "'"
        found.append(f"{key}{equals}{names}")
    return found


def can_be_read(word: str) -> bool:
    """Whether a word is key=value in Hydra's grammar."""
    try:
        OverridesParser.create().parse_override(word).value()
    except HydraException:
        return False
    return True


def _choices_of(group: str) -> list[str]:
    """What a group inside of another can be."""
    return [path.stem for path in (CONF / _path(group)).glob("*.yaml")]


def _have_laws(words: Sequence[str]) -> bool:
    """Whether the models of a command line, one or several, all have laws of several kinds."""
    names = [word.removeprefix("model=") for word in words if word.startswith("model=")]
    chosen = ",".join(names).split(",")
    return bool(names) and all((CONF / "model" / name / "named.yaml").is_file() for name in chosen)


def _listed(word: str) -> str:
    """Several names of parameter= as a list, for commas alone would make a sweep."""
    key, _, names = word.partition("=")
    return f"{key}=[{names}]" if key == "parameter" and "," in names and "[" not in names else word


def prepare_hydra() -> None:
    """Let Hydra raise what it finds instead of printing it, and give it our help."""
    print_any_text()
    os.environ[FULL_ERROR] = "1"
    Hydra.get_mode = _mode  # type: ignore[method-assign]
    Hydra.compose_config = _compose_config  # type: ignore[method-assign]
    defaults_list._create_interpolation_map = _choices_so_far
    if not OmegaConf.has_resolver("help"):
        OmegaConf.register_new_resolver("help", help_text)
        OmegaConf.register_new_resolver("run_name", lambda _root_: run_name(_root_))
        # ten characters for what was typed, in any order; kept for the configs of a sweep's runs
        same_for: Any = lambda words: digest("\n".join(sorted(words)))
        OmegaConf.register_new_resolver("same_for", same_for, use_cache=True)


_mode_of_config = Hydra.get_mode


def _mode(self: Hydra, config_name: str | None, overrides: list[str]) -> Any:
    """hydra.mode, for which Hydra would compose every config once more; none of ours says it."""
    if any("hydra.mode" in word or word.startswith(("-c", "--c")) for word in sys.argv[1:]):
        return _mode_of_config(self, config_name, overrides)
    return None


_compose_config_of_hydra = Hydra.compose_config


def _compose_config(self: Hydra, *args: Any, **more: Any) -> DictConfig:
    """A composed config. Raises ValueError for a launcher or a sweeper that Hydra does not have."""
    cfg = _compose_config_of_hydra(self, *args, **more)
    for key in ("launcher", "sweeper"):
        node = OmegaConf.to_container(cfg.hydra, resolve=False)[key]  # type: ignore[index, call-overload]
        require_plugin(f"hydra.{key}", node)
    return cfg


def require_plugin(key: str, node: Any) -> None:
    """Raise ValueError unless a node names a plugin of Hydra, and no other class inside of it."""
    targets = [*_targets(node)]
    known = Plugins.instance().class_name_to_class
    if len(targets) != 1 or not isinstance(node, dict) or node.get("_target_") not in known:
        named = " and ".join(map(shown, targets)) or shown(node)
        raise ValueError(f"{key}: {named} is no plugin of Hydra; choose with hydra/launcher=…")


def _targets(node: Any) -> Iterator[Any]:
    """Every `_target_` in a node."""
    if isinstance(node, dict):
        yield from ([node["_target_"]] if "_target_" in node else [])
    inner = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    for value in inner:
        yield from _targets(value)


_choices_of_hydra = defaults_list._create_interpolation_map


def _choices_so_far(overrides: Any, defaults_list: list[Any], self_added: bool) -> DictConfig:
    """What `${group}` among defaults resolves to; Hydra collects it for every file."""
    if any(default.is_interpolation() for default in defaults_list):
        return _choices_of_hydra(overrides, defaults_list, self_added)
    return DictConfig({})


def composed(*words: str, config: str = "train", whole: bool = False) -> DictConfig:
    """The config that a command line with these words would have; with Hydra's own if `whole`."""
    prepare_hydra()
    GlobalHydra.instance().clear()  # a program that is run by Hydra has one already
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose(config, placed(words), return_hydra_config=whole)


@contextmanager
def borrowed_hydra() -> Iterator[None]:
    """Hydra for a command that Python calls: whoever uses it there finds it as it was."""
    places = [
        (GlobalHydra.instance(), "hydra"), (HydraConfig.instance(), "cfg"),
        (JobRuntime.instance(), "conf"), (Hydra, "get_mode"), (Hydra, "compose_config"),
        (defaults_list, "_create_interpolation_map"),
    ]  # fmt: skip
    found, instances = [getattr(*place) for place in places], dict(Singleton._instances)
    told = os.environ.get(FULL_ERROR)
    JobRuntime.instance().conf = JobRuntime.instance().conf.copy()
    prepare_hydra()
    try:
        yield
    finally:
        Singleton._instances.update(instances)
        for place, value in zip(places, found, strict=True):
            setattr(*place, value)
        os.environ.pop(FULL_ERROR)
        os.environ.update({} if told is None else {FULL_ERROR: told})


def word_of(key: str, value: Any) -> Iterator[str]:
    """Words of the command line for a value of Python; those of a mapping set the keys below."""
    if isinstance(value, Mapping) and value:
        for name, below in value.items():
            yield from word_of(f"{key}.{name}", below)
    else:
        yield f"{key}={_typed(value)}"


def _typed(value: Any, inside: bool = False) -> str:
    """A value as Hydra reads it: text stays text, in quotes where it must, or is inside of another.

    Raises ValueError for what is no value, and for text that Hydra would resolve.
    """
    value = getattr(value, "folder", value)  # of a run
    value = value.tolist() if hasattr(value, "tolist") else value  # arrays and their numbers
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple | range):
        return f"[{','.join(_typed(one, inside=True) for one in value)}]"
    if isinstance(value, Mapping):
        if odd := [key for key in value if not str(key).isidentifier()]:
            raise ValueError(f"{shown(odd[0])} is no name of a setting in {shown(dict(value))}")
        return f"{{{','.join(f'{k}:{_typed(below, inside=True)}' for k, below in value.items())}}}"
    if not isinstance(value, str | os.PathLike):
        raise ValueError(f"{shown(value)} is no value of a setting: give numbers, text or lists")
    text = os.fspath(value)
    if "${" in text:
        raise ValueError(f"{shown(text)}: what begins with ${{ would be replaced; leave it out")
    with suppress(HydraException):
        own = OverridesParser.create().parse_override(f"key={text}").value()
        if not inside and own == text:
            return text
    return QuotedString(text, Quote.single).with_quotes()


def keys_of(config: str, *choices: str) -> list[str]:
    """All settings of a program with these choices, dotted."""
    return sorted({*GROUPS, *_dotted(composed(*choices, config=config))})


def _dotted(node: DictConfig, prefix: str = "") -> Iterator[str]:
    for key in node:
        name = f"{prefix}{key!s}"
        yield name
        if not OmegaConf.is_missing(node, key) and isinstance(node._get_node(key), DictConfig):
            yield from _dotted(node[key], f"{name}.")
