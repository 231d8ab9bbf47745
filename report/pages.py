"""Every generated page and figure of docs/, the command that makes it, and whether it is stale.

python -m report.pages          prints a table
python -m report.pages --make   makes anew what finished runs allow; no training
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.benchmarks import page as benchmarks
from report.collection.runs import collect, has_runs
from report.free_run import page as free_run
from report.online import page as online
from report.output import Section, printed
from report.paper import page as paper
from report.tuning import page as tuning
from runner.config.command_line import command_errors
from runner.config.compose import CONF
from runner.progress import is_finished

DOCS = CONF.parent / "docs"
CURRENT, UNKNOWN, SAME = "current", "of no runs, so nobody knows", "″"
ROOMS = {  # page: its room, which says what it needs
    "results.md": ("report.paper", paper.NEEDS),
    "free_run.md": ("report.free_run", free_run.NEEDS),
    "tuning.md": ("report.tuning", tuning.NEEDS),
    "benchmarks.md": ("report.benchmarks", benchmarks.NEEDS),
    "online.md": ("report.online", online.NEEDS),
}
CUTOFFS = Path("runs/cutoffs")
SWEEP = "model=vwnn system=bilinear,bouc_wen model.cutoff=20,50,100,200 seed=0,1,2,3"
MEASURED = {
    name: {Path("runs") / name: f"python train.py -m experiment={name} records=FOLDER"}
    for name in ("shake_table", "friction_damper")
}
BY_HAND: Mapping[str, tuple[str, Mapping[Path, str]]] = {  # pattern: what draws it, from what
    "published.md": ("python -m benchmarks.published --page docs/published.md", {}),
    "zoo.md": ("python -m models.zoo page", {}),
    "fine_tuning.md": ("python -m benchmarks.fine_tuning --page docs/fine_tuning.md", {}),
    "which_law.md": ("python -m benchmarks.which_law --page docs/which_law.md", {}),
    "unplanted.md": ("python -m benchmarks.unplanted.suite --page docs/unplanted.md", {}),
    "figures/unplanted_*.png": (
        "python -m benchmarks.unplanted.suite --page docs/unplanted.md",
        {},
    ),
    "figures/identified.png": ("python evaluate.py run=zoo:element_network/bilinear", {}),
    "figures/comparing.png": (
        "python evaluate.py runs=runs/cutoffs by=model.cutoff",
        {CUTOFFS: f"python train.py -m {SWEEP} hydra.sweep.dir={CUTOFFS}"},
    ),
    "figures/detection_*.png": ("python -m studies.detection --figures docs/figures", {}),
    "figures/online_*.png": ("python evaluate.py run=FOLDER", online.NEEDS),
    "figures/measured/frame_inspected.png": ("python -m data.inspect …, see docs/measured.md", {}),
    "figures/measured/frame_*.png": ("python evaluate.py run=FOLDER", MEASURED["shake_table"]),
    "figures/measured/damper_*.png": (
        "python evaluate.py run=FOLDER",
        MEASURED["friction_damper"],
    ),
}


@dataclass(frozen=True)
class Product:
    """Files of one command, and what it needs: {path: command that makes it}."""

    files: tuple[Path, ...]
    command: str
    needs: Mapping[Path, str]
    by_hand: bool = field(default=False)  # a person says of which run

    @property
    def missing(self) -> list[Path]:
        return [path for path in self.needs if not (path.is_file() or has_runs(path))]

    def state(self) -> str:
        """Why the files are stale; `current` where they are not."""
        reasons = [f"{path} is missing" for path in self.missing]
        for path in self.needs:
            reasons += list(self._stale(path)) if has_runs(path) else []
        reasons += [f"{path.name} is not there" for path in self.files if not path.is_file()]
        return "; ".join(reasons) or (CURRENT if self.needs else UNKNOWN)

    def _stale(self, folder: Path) -> Iterator[str]:
        runs = [run.folder for run in collect([folder]) if run.finished]
        if other := sum(not is_finished(run) for run in runs):
            yield f"{other} of {len(runs)} runs in {folder} are of another results version"
        made = max((path.stat().st_mtime for path in folder.rglob("metrics.json")), default=0.0)
        if self.files[0].is_file() and self.files[0].stat().st_mtime < made:
            yield f"older than the runs in {folder}"


def products(docs: Path = DOCS) -> list[Product]:
    """All of them, pages first; a figure belongs to the page that links to it."""
    left = set(docs.rglob("*.png"))
    by_hand = []
    for pattern, (command, needs) in BY_HAND.items():
        matches = set(docs.glob(pattern))
        files = tuple(sorted(matches & left if pattern.endswith(".png") else matches))
        left -= matches
        by_hand.append(Product(files, command, needs, by_hand=True))
    pages = []
    for name, (room, needs) in ROOMS.items():
        links = re.findall(r"\]\((figures/[^)]+)\)", (docs / name).read_text("utf-8"))
        figures = [docs / link for link in dict.fromkeys(links) if docs / link in left]
        command = f"python -m {room} --page docs/{name}"
        pages.append(Product((docs / name, *figures), command, needs))
    return pages + [product for product in by_hand if product.files]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", action="store_true", help="what can be made from finished runs")
    with command_errors():
        options = parser.parse_args()
        if options.make:
            make(products())
        found = products()
        lines = []
        for product in found:
            names = [file.relative_to(DOCS.parent).as_posix() for file in product.files]
            lines.append([names[0], product.command, product.state()])
            lines += [[name, SAME, SAME] for name in names[1:]]
        head = ("page or figure", "made by", "state")
        console = terminal(160)
        console.print(printed(Section(head, lines), left=(0, 1, 2)))
        wanted = {path: product.needs[path] for product in found for path in product.missing}
        for path, command in wanted.items():
            console.print(f"{path} is made by {command}", soft_wrap=True, highlight=False)


def make(found: list[Product]) -> None:
    """Run the commands of pages whose runs are there. Raises ValueError where one fails."""
    for product in found:
        if product.by_hand or product.missing:
            continue
        print(product.command, flush=True)
        command = [sys.executable, *shlex.split(product.command)[1:]]
        if subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode:
            raise ValueError(f"{product.command} failed; see above")


if __name__ == "__main__":
    main()
