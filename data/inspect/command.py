"""The command that trains on an inspected record: settings of its data, a model that suits it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml

from data.measured.channels import beside, has_gaps, numbered, signal_of
from data.measured.floors import floor_numbers, least_storeys
from data.measured.raw_record import Finding


def floors_without_sensor(channels: Mapping[str, str]) -> int:
    """How many storeys there are at least, by {channel: column}; 0 where each may have a sensor."""
    of_floors = {c: name for c, name in channels.items() if signal_of(c) in ("a", "v", "x")}
    dofs = {number for signal in "avx" for number in numbered(of_floors, signal)}
    least = max(least_storeys(list(of_floors.values())), *dofs, *numbered(channels, "drift"), 0)
    return least if least > len(dofs) else 0


def advice_on_floors(channels: Mapping[str, str]) -> str:
    """How {channel: column} are numbered by floors that names of columns say, for their drifts.

    Empty where a name says no floor, or where channels have these numbers.
    """
    columns = [column for channel, column in channels.items() if signal_of(channel) == "a"]
    floors = {f"a{n}": c for n, c in zip(floor_numbers(columns), columns, strict=False)}
    if "s_ddot" not in map(signal_of, channels) or floors.keys() <= channels.keys():
        return ""
    others = {channel: c for channel, c in channels.items() if signal_of(channel) != "a"}
    setting = shlex.quote(f"data.channels={for_hydra(others | floors)}")
    return (
        f"for drifts of all storeys number channels by floors: {setting} model=element_network "
        "model.laws=named (numbers are one less where the first floor is the ground; the roof has "
        "the number of storeys); see docs/few_sensors.md"
    )


def model_for(channels: Mapping[str, str]) -> list[str]:
    """A model that simulates {channel: column} as measured, in words of the command line.

    Elements with laws: of a test of one, or of a structure, with x and v where they were measured
    beside accelerations. Floors above a ground that shakes are a chain: named laws, found storey by
    storey, have fewer numbers than units of all storeys together; also where floors have no sensor
    and channels have the numbers of floors, or beside displacements and drifts. Modes, where names
    of columns alone say that floors have none. Other inputs have a place in a network without laws
    alone.
    """
    signals = {signal_of(channel) for channel in channels}
    if "r" in signals:
        return ["model=element_test"]
    if "u" in signals:
        return ["model=gru"]
    if floors_without_sensor(channels):
        own = numbered(channels, "a") or numbered(channels, "x")
        numbers = has_gaps(own) or bool(beside(channels, "acceleration"))
        known = "s_ddot" in signals and numbers
        return ["model=element_network", "model.laws=named"] if known else ["model=modal_network"]
    if {"a", "x", "v"} <= signals or "a" not in signals:
        return ["model=element_network"]
    if "s_ddot" in signals and len(numbered(channels, "a")) > 1:
        return ["model=element_network", "model.laws=named", "model.from_accelerations=true"]
    return ["model=element_network", "model/reads=accelerations"]


def direct_command(
    settings: Mapping[str, Any], channels: Mapping[str, str], mends: Sequence[str]
) -> str:
    """Command that trains on records; mends: what their faults ask for.

    settings: of `data=measured`, None for what is not said; channels: {channel: column}.
    """
    words = [*data_words(settings, mends), *model_for(channels)]
    return f"python train.py {shlex.join(words)}"


def data_words(settings: Mapping[str, Any], mends: Sequence[str]) -> list[str]:
    """Words of a command line that read records; of each repair the largest."""
    each = dict(settings)
    units = each.pop("units", None) or {}
    each |= {f"units.{name}": unit for name, unit in units.items()}
    said = [f"data.{key}={for_hydra(value)}" for key, value in each.items() if value]
    rising = sorted(mends, key=lambda word: _number(word.partition("=")[2]))
    largest = {word.partition("=")[0]: word for word in rising}
    return ["data=measured", *said, *largest.values()]


def mends_of(findings: Iterable[Finding]) -> list[str]:
    """Settings that faults ask for, as words of a command line."""
    quoted = re.compile(r"""(?<!\w)'[^']*'(?!\w)|"[^"]*\"""")  # a column: 'data.mend.fill=9'
    texts = " ".join(quoted.sub("", finding.message) for finding in findings)
    return re.findall(r"data\.mend\.\w+=[\w.+-]*\w", texts)


def for_hydra(value: Any) -> str:
    r"""A value of the command line: words, lists and mappings of them; text stays text.

    OmegaConf takes \${ for ${, and each backslash before it doubled; ??? alone is a missing value.
    """
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {for_hydra(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(for_hydra, value)) + "]"
    if not isinstance(value, str):
        return str(value).lower()
    if re.fullmatch(r"[A-Za-z_/.][A-Za-z0-9_/.-]*", value) and yaml.safe_load(value) == value:
        return value
    value = "${oc.decode:'???'}" if value == "???" else re.sub(r"(\\*)\$\{", r"\1\1\\${", value)
    quoted = re.sub(r'(\\*)"', r'\1\1\\"', re.sub(r"(\\+)$", r"\1\1", value))
    return f'"{quoted}"'


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
