"""The page of on-line models: report/online/page.md with the tables of finished runs."""

from __future__ import annotations

from pathlib import Path
from string import Template

from report.collection.runs import collect, other_version, stated
from report.online.cases import read_online
from report.online.tables import learning_table, settling_tables, stability_table
from report.usual import ONLINE, STABILITY
from runner.folder.run_folder import write_text

TEMPLATE = Path(__file__).with_name("page.md")
NEEDS = {  # of the page: what makes it
    ONLINE: "python train.py -m experiment=online",
    STABILITY: "python train.py -m experiment=online_stability",
}
SETTLING = "vwnn"  # the estimator whose settling the page shows


def write_online_page(page: Path, online: Path, stability: Path, settling: str = SETTLING) -> None:
    """Fill the template from the runs in two folders. Raises ValueError for missing runs."""
    tables = {
        "learnt": learning_table(read_online(online)),
        "settled": settling_tables(read_online(online, settling)),
        "stable": stability_table(read_online(stability)),
    }
    texts = {name: "\n".join(lines) for name, lines in tables.items()}
    texts["earlier"] = stated(other_version(collect([online, stability])))
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(texts))
