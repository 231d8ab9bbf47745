"""A run's model in one format or several: all of the files are written, or none."""

from __future__ import annotations

import importlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from data.terminal import terminal
from export.run import Exported, read_exported
from export.targets import TARGETS


def export(run: Path, targets: Sequence[str], output: Path) -> list[tuple[str, Path]]:
    """Target and path of each file that was written.

    Raises ValueError where the run holds no sound model, or a target cannot take it: nothing is
    written then. Files of the same names are replaced.
    """
    model = read_exported(run)
    first = next(part for part in (output, *output.parents) if part.exists())
    with tempfile.TemporaryDirectory(prefix=".export", dir=first) as aside:
        files = written(model, targets, Path(aside))
        output.mkdir(parents=True, exist_ok=True)
        return [(target, _moved(path, Path(aside), output)) for target, path in files]


def written(model: Exported, targets: Sequence[str], folder: Path) -> list[tuple[str, Path]]:
    """Target and path of each file, in a folder. Raises ValueError naming all that refused."""
    files, refused = [], []
    for target in targets:
        try:
            write = importlib.import_module(f"export.{target}").write
            files += [(target, path) for path in write(model, folder)]
        except ModuleNotFoundError as error:
            refused.append(f"{target}: needs {error.name}: pip install -e '.[export]'")
        except ValueError as error:
            refused.append(f"{target}: {error}")
    if refused:
        rest = [
            target for target in targets if not any(r.startswith(f"{target}:") for r in refused)
        ]
        hint = f"; nothing was written, to={','.join(rest)} would be" if rest else ""
        raise ValueError(f"{'; '.join(refused)}{hint}")
    return files


def _moved(path: Path, aside: Path, output: Path) -> Path:
    to = output / path.relative_to(aside)
    to.parent.mkdir(parents=True, exist_ok=True)
    os.replace(path, to)
    return to


def show(files: Sequence[tuple[str, Path]]) -> None:
    """Print the files, their sizes and who they are for."""
    table, before = Table("file", "kB", "for", box=None), ""
    table.columns[1].justify = "right"
    for target, path in files:
        reader = "" if target == before else TARGETS[target]
        table.add_row(path.name, f"{path.stat().st_size / 1000.0:.1f}", reader)
        before = target
    terminal().print(table)
    print(f"written to {files[0][1].parent}")
