"""`python evaluate.py run=FOLDER page=html`, or runs=."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from report.collection.runs import folders_of, results_folder
from report.page.page import write_page, write_runs_page
from report.run.evaluation import said_alone
from runner.config.command_line import absolute
from runner.folder.run_folder import run_folder

SCORES = ("uncertainty", "change", "seeds", "scenario", "by")  # ask for other numbers


def page_of(asked: Mapping[str, Any]) -> Path:
    """Write the page of one run, or of many, and print where it is.

    asked: as in conf/evaluate.yaml. Raises ValueError for words that ask for other scores.
    """
    others = [key for key in SCORES if asked.get(key)]
    others += [f"data.{key}" for key in said_alone(asked["data"])]
    others += ["output"] if asked["run"] is not None and asked["output"] else []
    if others:
        raise ValueError(f"page=html shows runs as they were trained; leave {others[0]}= out")
    if (asked["run"] is None) == (not asked["runs"]):
        raise ValueError("page=html of what? say run=FOLDER, or runs=FOLDER to compare many")
    if asked["run"] is not None:
        page = write_page(absolute(run_folder(asked["run"])))
    else:
        folders = folders_of(asked["runs"])
        output = absolute(asked["output"]) if asked["output"] else results_folder(folders)
        page = write_runs_page(folders, output)
    print(f"page in {page}")
    return page
