"""A ready config of a measured record, with guesses and remedies as comments.

Nothing guessed takes effect before somebody who knows the sensors takes its # away.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from data.arguments import plain
from data.measured.channels import signal_of
from data.measured.finding import Finding


def config_path(wanted: str, record: Path) -> Path:
    """FOLDER/data/NAME.yaml, where Hydra looks for data=NAME under --config-dir FOLDER.

    wanted: a folder, or the .yaml file itself.
    """
    place = Path(wanted)
    if place.suffix not in (".yaml", ".yml"):
        name = re.sub(r"\W+", "_", record.resolve().stem).strip("_") or "record"
        return place / "data" / f"{name}.yaml"
    inside = place.resolve().parent.name == "data"
    return place.with_suffix(".yaml") if inside else place.parent / "data" / f"{place.stem}.yaml"


def command(config: Path, channels: Iterable[str]) -> str:
    """Command that trains on a config; accelerations alone are integrated first."""
    signals = {signal_of(channel) for channel in channels}
    scenario = " scenario=integrated" if "a" in signals and not {"x", "v"} <= signals else ""
    folder = config.parent.parent
    return f"python train.py --config-dir {folder} data={config.stem} model=vwnn{scenario}"


def write_config(
    path: Path, settings: Mapping[str, Any], guesses: Mapping[str, str], findings: Sequence[Finding]
) -> None:
    """Write the settings of `data=measured` for one record; guesses and remedies as comments."""
    chosen = {k: v for k, v in settings.items() if k not in ("path", "channels") and v is not None}
    channels = settings.get("channels") or {}
    inner = [
        *_dumped({"path": settings["path"]}),
        *_channels(channels, guesses),
        *_dumped(chosen),
        *_remedies(findings),
    ]
    text = [
        "# @package _global_",
        f"# {plain(Path(settings['path']).name)}, as python -m data.inspect understood it",
        f"# {command(path, channels or guesses.values())}",
        "defaults: [measured, _self_]",
        "data:",
        *(f"  {line}" for line in inner),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(text) + "\n", encoding="utf-8")


def _channels(channels: Mapping[str, str], guesses: Mapping[str, str]) -> Iterator[str]:
    if channels:
        yield from _dumped({"channels": dict(channels)})
    elif guesses:
        yield "channels: # guesses: take away the # of each line that is right"
        for column, channel in guesses.items():
            yield f"  # {_dumped({channel: column})[0]}"


def _remedies(findings: Sequence[Finding]) -> Iterator[str]:
    """Settings that the findings name; of several values of one setting, the largest."""
    remedies: dict[str, tuple[str, str]] = {}
    for finding in findings:
        named = re.search(r"data\.(mend\.\w+|dt)=([\w.+-]+)", finding.message)
        if named is None:
            continue
        key, value = named[1], named[2].rstrip(".")
        old = remedies.get(key, ("", ""))[0]
        if not old or (_number(value) > _number(old)):
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
    """Lines of YAML; a column called ${…} must not be taken for an interpolation."""
    if not settings:
        return []
    text = yaml.safe_dump(
        _escaped(dict(settings)), sort_keys=False, allow_unicode=True, width=10_000
    )
    return text.splitlines()


def _escaped(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _escaped(inner) for key, inner in value.items()}
    return value.replace("${", "\\${") if isinstance(value, str) else value
