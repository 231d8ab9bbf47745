"""Give finished runs of version 0.11.0 their results version, so that sweeps skip them.

    python -m runner.stamp FOLDER [FOLDER …]

Name folders whose runs version 0.11.0 made. Until then a run said which code had made it, as a hash
that later versions cannot compute: no file tells runs of 0.11.0 from earlier ones, which may have
other numbers. Runs that have a results version, and published ones, are unchanged.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from data.arguments import Parser, reason
from models.zoo.index import published
from runner.config.command_line import command_errors
from runner.folder.lock import hold, release
from runner.folder.run_folder import FAILED, METRICS, read_failure, read_metrics, write_json
from runner.progress import print_damaged

OF_0_11 = 1  # results version of 0.11.0: there was no other before


def stamp(folder: Path) -> bool:
    """Whether a run that ended was given its results version; the times of its file stay.

    Pages made of the run are not stale by it. Raises ValueError for a damaged file, and where
    another process works in the folder.
    """
    numbers = (folder / METRICS).is_file()
    path = folder / (METRICS if numbers else FAILED)
    content = read_metrics(folder) if numbers else read_failure(folder)
    origin = content.get("identity", {}) if numbers else content
    if not origin.get("code") or origin.get("results") is not None or published(folder):
        return False
    hold(folder)
    times = path.stat()
    origin["results"] = OF_0_11
    write_json(path, content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    release(folder)
    return True


def main(words: Sequence[str] | None = None) -> None:
    """Stamp every run below the folders that are named."""
    parser = Parser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    folders = parser.parse_args(words).folders
    if absent := [folder for folder in folders if not folder.is_dir()]:
        raise ValueError(f"there is no folder {absent[0]}; name the folder of a run or a sweep")
    runs = {path.parent for f in folders for name in (METRICS, FAILED) for path in f.rglob(name)}
    stamped, damaged = 0, {}
    for run in sorted(runs):
        try:
            stamped += stamp(run)
        except (ValueError, OSError) as error:
            damaged[run.name] = reason(error)
    print_damaged(damaged)
    print(f"{stamped} of {len(runs)} runs were given results version {OF_0_11}")


if __name__ == "__main__":
    with command_errors():
        main()
