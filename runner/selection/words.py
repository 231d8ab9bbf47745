"""What a person typed for identify.py, before anything heavy is loaded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from glob import glob
from pathlib import Path
from typing import NamedTuple

from runner.config.command_line import check_words
from runner.config.settings import seconds_of

SETTING = re.compile(r"[+~]*[A-Za-z_][\w./]*=")


class Words(NamedTuple):
    """Records; settings as typed; seconds and the folder of the result, where they were said."""

    records: list[str]
    settings: list[str]
    budget: float | None
    folder: str | None


def read_words(words: Sequence[str]) -> Words:
    """The words by what they are.

    Raises ValueError without a record that is there, or a time, and HydraException for a word that
    cannot be read.
    """
    settings = [w for w in words if SETTING.match(w) and not Path(w).exists()]
    records = [w for w in words if w not in settings]
    if not records:
        raise ValueError("name the record: python identify.py record.csv; see --help")
    for record in records:
        if not record:
            raise ValueError("the name of a record is empty; see --help")
        if not (glob(record) or Path(record).exists()):
            from data.measured.files.table import check_path  # its readers take a while to load

            check_path(Path(record))
    own = {key: [w.partition("=")[2] for w in settings if w.startswith(f"{key}=")]
           for key in ("budget", "hydra.run.dir")}  # fmt: skip
    settings = [w for w in settings if w.partition("=")[0] not in own]
    folder, said = (own[key][-1] if own[key] else None for key in ("hydra.run.dir", "budget"))
    budget = seconds_of(said)
    if said is not None and not budget:
        raise ValueError(f"budget={said}: expected a time, such as 60s or 10min")
    for word in check_words(settings, "identify", sweeps=False):
        if word.is_sweep_override():
            key, _, values = str(word.input_line).partition("=")
            raise ValueError(f"{key}={values} gives several values; a list is {key}=[{values}]")
    return Words(records, settings, budget, folder)
