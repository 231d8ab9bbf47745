"""A ready config of a measured record, with guesses and remedies as comments.

Nothing guessed takes effect before somebody who knows the sensors takes its # away.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from data.arguments import plain
from data.measured.channels import beside, has_gaps, numbered, signal_of
from data.measured.floors import floor_numbers, least_storeys
from data.measured.raw_record import Finding
from data.plain_data import escaped
from data.whole_file import write_text

OWN = Path(__file__).parents[2] / "conf" / "data"


def config_path(wanted: str, record: Path) -> Path:
    """FOLDER/data/NAME.yaml, where Hydra looks for data=NAME under --config-dir FOLDER.

    wanted: a folder, or the .yaml file itself. Raises ValueError for a name that the project's own
    configs have, which come before --config-dir.
    """
    place = Path(wanted)
    taken = {path.stem for path in OWN.glob("*.yaml")}
    if place.suffix not in (".yaml", ".yml"):
        name = re.sub(r"\W+", "_", plain(record.resolve().stem))[:60].strip("_") or "record"
        return place / "data" / f"{name}{'_record' if name in taken else ''}.yaml"
    if place.stem in taken:
        raise ValueError(
            f"--config {wanted}: data={place.stem} is a config of the project itself; choose "
            "another name"
        )
    inside = Path(os.path.abspath(place)).parent.name == "data"
    return place.with_suffix(".yaml") if inside else place.parent / "data" / f"{place.stem}.yaml"


def command(config: Path, channels: Mapping[str, str]) -> str:
    """Command that trains on a config, as a shell and Hydra take it, by {channel: column}."""
    folder = str(Path(os.path.abspath(config)).parent.parent)
    folder = folder if config.is_absolute() else os.path.relpath(folder)
    folder = f"./{folder}" if folder.startswith("-") else folder
    words = ["--config-dir", folder, f"data={for_hydra(config.stem)}", *model_for(channels)]
    return f"python train.py {shlex.join(words)}"


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
    """Command that trains on records without a config; mends: what their faults ask for.

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
    texts = " ".join(finding.message for finding in findings)
    return re.findall(r"data\.(?:mend\.\w+|dt)=[\w.+-]*\w", texts)


def for_hydra(value: Any) -> str:
    """A value of the command line: words, lists and mappings of them."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {for_hydra(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(for_hydra, value)) + "]"
    if not isinstance(value, str):
        return str(value).lower()
    if re.fullmatch(r"[A-Za-z_/.][A-Za-z0-9_/.-]*", value) and yaml.safe_load(value) == value:
        return value
    quoted = re.sub(r'(\\*)"', r'\1\1\\"', re.sub(r"(\\+)$", r"\1\1", value))
    return f'"{quoted}"'


def write_config(
    path: Path,
    settings: Mapping[str, Any],
    guesses: Mapping[str, str],
    findings: Sequence[Finding],
    units: Mapping[str, str] | None = None,
) -> None:
    """Write the settings of `data=measured` for one record; guesses and remedies as comments.

    guesses: {column: channel}; units: {signal: unit} to propose where the file says none.
    """
    chosen = {k: v for k, v in settings.items() if k not in ("path", "channels") and v is not None}
    channels = settings.get("channels") or {}
    train = command(path, channels or {c: column for column, c in guesses.items()})
    inner = [
        *_dumped({"path": settings["path"]}),
        *_channels(channels, guesses),
        *_units(chosen.pop("units", None) or {}, units or {}),
        *_dumped(chosen),
        *_remedies(findings),
    ]
    text = [
        "# @package _global_",
        f"# {plain(Path(settings['path']).name)}, as python -m data.inspect understood it",
        f"# {plain(train)}",
        "defaults: [measured, _self_]",
        "data:",
        *(f"  {line}" for line in inner),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "\n".join(text) + "\n")


def _channels(channels: Mapping[str, str], guesses: Mapping[str, str]) -> Iterator[str]:
    if channels:
        yield "channels:"
        yield from (f"  {line}" for line in _dumped(channels))
    elif guesses:
        yield "channels: # guesses: take away the # of each line that is right"
        for column, channel in guesses.items():
            yield f"  # {_dumped({channel: column})[0]}"


def _units(said: Mapping[str, str], likely: Mapping[str, str]) -> Iterator[str]:
    if said or likely:
        guessed = " # no unit was understood: take away the # of each line that is right"
        yield f"units:{guessed if likely else ''}"
        yield from (f"  {line}" for line in _dumped(said))
        for signal, units in likely.items():
            unit, *others = units.split("|")
            yield f"  # {_dumped({signal: unit})[0]}{' # or ' * bool(others)}{', '.join(others)}"


def _remedies(findings: Sequence[Finding]) -> Iterator[str]:
    """Settings that the findings name; of several values of one setting, the largest."""
    remedies: dict[str, tuple[str, str]] = {}
    for finding in findings:
        for word in mends_of([finding])[:1]:
            key, _, value = word.removeprefix("data.").partition("=")
            if key not in remedies or _number(value) > _number(remedies[key][0]):
                remedies[key] = (value, f"{finding.what} {finding.channel}".strip())
    mends = {k.removeprefix("mend."): v for k, v in remedies.items() if k.startswith("mend.")}
    if mends:
        yield "# mend: # take away the # of this line and of each repair that you want"
        yield from (f"#   {key}: {value} # {plain(why)}" for key, (value, why) in mends.items())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _dumped(settings: Mapping[str, Any]) -> list[str]:
    """A line of YAML for each value; unchanged once composed and resolved."""
    return [f"{_scalar(key)}: {_value(value)}" for key, value in settings.items()]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_scalar(k)}: {_scalar(v)}" for k, v in value.items()) + "}"
    return _scalar(value)


def _scalar(value: Any) -> str:
    """One line of YAML: a plain word, else in double quotes with escapes."""
    if not isinstance(value, str):
        return str(yaml.safe_dump(value)).split("\n")[0]
    if re.fullmatch(r"[A-Za-z/][A-Za-z0-9_./]*", value) and yaml.safe_load(value) == value:
        return value
    dumped = yaml.safe_dump(literal(value), default_style='"', width=math.inf)
    return str(dumped).removesuffix("\n")


def literal(text: str) -> str:
    """Text that OmegaConf, which resolves it once, gives back as it is.

    k backslashes before ${ become 2 k + 1: a pair becomes one, the last keeps the ${ from
    being an interpolation. Three question marks alone would mean that a value is missing.
    """
    if text == "???":
        return "${oc.decode:\"'???'\"}"
    return escaped(text)
