"""What a run's numbers follow from: every choice that can change one, and the results version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig

from models import KINDS, class_name
from models.stored.earlier_keys import GONE_SINCE
from runner.config.choices import plain

# The results version. It rises by one in every change after which a run of the same choices has
# other numbers, be it in the last digit; a change of form leaves it. The golden values say which it
# was: `python -m tests.golden`. Finished runs of another version are repeated by their sweep.
RESULTS = 9
WORDS = "about"  # of a choice, for tables and pictures
INERT = ("figures", "logger", "checkpoint_seconds", "grid")  # they change no number,
INERT_DATA = ("calibration_records",)  # nor do records of their own that bands are made from
INERT_TRAINER = ("enable_progress_bar", "log_every_n_steps")  # nor do these of the trainer


def digest(text: str) -> str:
    """Ten characters of a text's hash."""
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def config_digest(content: dict[str, Any]) -> str:
    """Ten characters that tell runs apart: a hash of every choice that can change a number."""
    return digest(choices_text(content))


def choices_text(content: dict[str, Any]) -> str:
    """Every choice that can change a number, always in the same order."""
    content = _without_words({k: v for k, v in content.items() if k not in INERT})
    content["model"] = with_class_of_laws(content["model"])
    for part in ("model", "objective"):
        if content.get(part) is not None:
            content[part] = {**GONE_SINCE.get(content[part].get("_target_"), {}), **content[part]}
    for later in ("start", "budget"):  # as in runs of older code, which have no such setting
        if content.get(later) is None:
            content.pop(later, None)
    content["data"] = {k: v for k, v in content["data"].items() if k not in INERT_DATA}
    for later in ("calibration", "quasi_static", "delay", "run_in", "sensors"):  # likewise
        if content["data"].get(later, "") is None:
            del content["data"][later]
    # a sensor on each, no storeys, no strains, masses that are as certain as usual
    for later in ("dofs", "heights", "rows", "masses_within"):
        if content["model"].get(later, "") is None:
            del content["model"][later]
    if isinstance(units := content["data"].get("units"), dict):  # of signals that came later
        content["data"]["units"] = {
            k: v for k, v in units.items() if k not in ("drift", "strain") or v is not None
        }
    if content["data"].get("decimal", "") is None:  # which was a point where nothing was said
        content["data"]["decimal"] = "."
    content["trainer"] = {k: v for k, v in content["trainer"].items() if k not in INERT_TRAINER}
    return json.dumps(content, sort_keys=True, ensure_ascii=False)


def with_class_of_laws(model: Mapping[str, Any]) -> dict[str, Any]:
    """A model's settings with the class of its laws in place of their name, as 0.11 said it."""
    room, _, name = str(model.get("_target_")).partition(".")
    try:
        known = class_name(name, model.get("laws"))
    except ValueError:  # of laws that there are not: no run follows
        known = name
    if known == name and name not in KINDS:
        return dict(model)
    named = known == KINDS[name]["named"]  # whose classes had a setting of this name before
    laws = {"laws": model["laws"] if isinstance(model["laws"], list) else None} if named else {}
    return {k: v for k, v in model.items() if k != "laws"} | {"_target_": f"{room}.{known}"} | laws


def name_of(content: dict[str, Any], digest: str = "") -> str:
    """Folder within a sweep of the run with these resolved values; digest: theirs, if known."""
    names = (content[part]["name"] for part in ("model", "system", "scenario"))
    return "-".join((*names, f"seed{content['seed']}", digest or config_digest(content)))


def run_name(cfg: DictConfig) -> str:
    return name_of(plain(cfg))


def _without_words(node: dict[str, Any]) -> dict[str, Any]:
    """The same without what choices say about themselves."""
    kept = {key: value for key, value in node.items() if key != WORDS}
    return {k: _without_words(v) if isinstance(v, dict) else v for k, v in kept.items()}


def identity_of(content: dict[str, Any], digest: str = "") -> dict[str, Any]:
    """What a run's numbers follow from; digest: of these resolved values, if known."""
    return {"config": digest or config_digest(content), "results": RESULTS}


def is_current(metrics: Mapping[str, Any]) -> bool:
    """Whether a run is of this results version; those of 0.11 have none."""
    return bool(metrics.get("identity", {}).get("results") == RESULTS)
