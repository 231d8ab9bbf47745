"""The table of docs/export.md: each target takes what the page says that it takes."""

from __future__ import annotations

import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from export.targets import TARGETS
from tests.export.conftest import exported, network

PAGE = Path(__file__).parents[2] / "docs" / "export.md"
ROWS = re.findall(r"^\| `(\w+)` \| (.+?) \|", PAGE.read_text("utf-8"), flags=re.MULTILINE)
NEEDED = {"fmu": shutil.which("gcc")}


def test_the_page_has_every_target():
    assert [target for target, _ in ROWS] == list(TARGETS)


@pytest.mark.parametrize(("target", "files"), ROWS)
def test_each_row_writes_its_files_for_a_network_of_elements(target, files, tmp_path):
    if not NEEDED.get(target, True):
        pytest.skip(f"to={target} needs more than is installed")
    model = exported(network(1, 1, ("hinge_stiffness",), hinges=1, units=0), "building")
    paths = import_module(f"export.{target}").write(model, tmp_path)
    written = {path.name for path in paths}
    assert written == {path.name for path in tmp_path.iterdir()}
    assert written == set(re.findall(r"`([\w.-]+)`", files.replace("NAME", "building")))
    text = b"".join(path.read_bytes() for path in paths)
    assert target == "fmu" or b"structural-model-zoo" in text  # the passport
