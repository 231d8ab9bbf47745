"""The published models: every entry loads, runs as it did, and says what was done to it."""

from __future__ import annotations

import json
import re
import shutil
import warnings

import pytest
import torch
import yaml

from data.record import Drive
from data.simulation.accelerograms import Accelerogram
from models.zoo import list_pretrained, load_pretrained
from models.zoo.golden import difference
from models.zoo.index import ROOT, Entry, entries, entry_of, folder_of
from models.zoo.pretrained import OutsideEnvelopeWarning

ENTRIES = entries()
MEGABYTE = 1_000_000
HERE = re.compile(rb"(?<![\w.:/])(?:/(?:work|home|root|tmp|usr|opt|mnt|Users)/|~/|\.\./\.\./)")


def drive_of(name: str, size: float, samples: int = 200) -> tuple[object, Drive]:
    pretrained = load_pretrained(name)
    n, m = pretrained.model.dofs, pretrained.model.inputs
    t = torch.arange(samples, dtype=torch.float64)[:, None]
    u = size * torch.sin(0.1 * t + torch.arange(m))
    return pretrained, Drive(pretrained.model.dt, u, torch.zeros(n), torch.zeros(n))


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_a_published_free_run_is_what_it_was(entry):
    """A change of code that alters one by more than 1e-9 of its size is found here."""
    assert difference(load_pretrained(entry.name).model, entry.folder / "golden.npz") <= 1e-9


def test_the_zoo_is_below_a_megabyte():
    files = [path for path in ROOT.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= MEGABYTE
    published = {e.folder / name for e in ENTRIES for name in e.facts["files"]}
    assert set(files) == {*published, ROOT / "index.json"}


def test_no_file_names_a_folder_of_a_machine():
    for path in (path for path in ROOT.rglob("*") if path.is_file()):
        found = HERE.search(path.read_bytes())
        assert found is None or path.suffix in (".npz", ".xz", ".safetensors"), (path, found)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_a_card_has_front_matter_and_tells_all(entry):
    text = (entry.folder / "card.md").read_text("utf-8")
    _, front, body = text.split("---\n", 2)
    front = yaml.safe_load(front)
    (model,) = front["model-index"]
    (result,) = model["results"]
    assert model["name"] == entry.name
    assert {"task", "dataset", "metrics", "source"} <= set(result)
    assert all(isinstance(metric["value"], float) for metric in result["metrics"])
    one_step = entry.facts["one_step_percent"]
    assert result["metrics"][-1]["value"] == pytest.approx(one_step, abs=1e-6)
    heads = ("Use it", "Signals", "Training envelope", "How well", "Where it fails", "Made by")
    for head in (*heads, "Licence"):
        assert f"\n## {head}\n" in body
    assert "python train.py" in body


@pytest.fixture
def copied(tmp_path) -> Entry:
    """One entry in a zoo of its own."""
    name = "linear/bilinear.v1"
    shutil.copytree(ROOT / name, tmp_path / name)
    content = json.loads((ROOT / "index.json").read_text("utf-8"))
    content["entries"] = {name: content["entries"][name]}
    (tmp_path / "index.json").write_text(json.dumps(content))
    return entry_of(name, tmp_path)


def test_any_byte_that_is_changed_is_named(copied, tmp_path):
    assert folder_of("zoo:linear/bilinear", tmp_path) == copied.folder
    for name, published in copied.facts["files"].items():
        path = copied.folder / name
        content = path.read_bytes()
        for place in (0, len(content) // 2, len(content) - 1):
            changed = bytearray(content)
            changed[place] ^= 1
            path.write_bytes(changed)
            own, expected = r"SHA-256 [0-9a-f]{64}", published["sha256"]
            told = rf"{re.escape(name)} is not .*{own}, expected {expected}"
            with pytest.raises(ValueError, match=told):
                load_pretrained("linear/bilinear", tmp_path)
        path.unlink()
        with pytest.raises(ValueError, match=rf"lacks {re.escape(name)}"):
            folder_of("zoo:linear/bilinear", tmp_path)
        path.write_bytes(content)
    (copied.folder / "more.py").write_text("")
    with pytest.raises(ValueError, match=r"holds more\.py, which was not published"):
        load_pretrained("linear/bilinear", tmp_path)


def test_an_index_that_is_damaged_is_remarks_of(copied, tmp_path):
    index = tmp_path / "index.json"
    content = json.loads(index.read_text())
    for damaged in ("{", "[]", '{"format": 9, "entries": {}}', '{"format": 1}'):
        index.write_text(damaged)
        with pytest.raises(ValueError, match=r"index\.json is damaged"):
            entry_of("linear/bilinear", tmp_path)
    content["entries"]["linear/../../bilinear.v1"] = content["entries"].pop("linear/bilinear.v1")
    index.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="is damaged"):
        entry_of("linear/bilinear", tmp_path)


def test_the_newest_version_is_taken_and_any_can_be_pinned(copied, tmp_path):
    content = json.loads((tmp_path / "index.json").read_text())
    for version in (2, 10):
        shutil.copytree(copied.folder, tmp_path / f"linear/bilinear.v{version}")
        content["entries"][f"linear/bilinear.v{version}"] = dict(copied.facts)
    (tmp_path / "index.json").write_text(json.dumps(content))
    assert load_pretrained("linear/bilinear", tmp_path).name == "linear/bilinear.v10"
    assert load_pretrained("linear/bilinear.v2", tmp_path).name == "linear/bilinear.v2"
    assert len(list_pretrained(root=tmp_path)) == 1


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("element_network/bouc_wenn", "element_network/bouc_wen"),
        ("zoo:elementnetwork/bilinear", "element_network/bilinear"),
        ("linear/bilinear.v7", "linear/bilinear"),
        ("transformer/polynomial", "/polynomial"),
        ("../../etc", "python -m models.zoo list"),
    ],
)
def test_a_name_that_is_not_published_says_what_comes_near(name, near):
    with pytest.raises(ValueError, match="is not published") as error:
        load_pretrained(name)
    assert near in str(error.value)
    assert "\n" not in str(error.value)


def test_a_motion_outside_the_envelope_is_warned_of():
    pretrained, small = drive_of("element_network/bouc_wen", 0.05, samples=50)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pretrained.inside(small)
    _, large = drive_of("element_network/bouc_wen", 200.0)
    with pytest.warns(OutsideEnvelopeWarning, match="the largest excitation of f"):
        assert not pretrained.inside(large)


def test_an_earthquake_shakes_a_base_and_masses_alike():
    ground = Accelerogram("pulse", 0.02, 0.1 * torch.sin(torch.arange(200) * 0.3).numpy())
    frame = load_pretrained("element_network/shake_table_frame")
    drive = frame.shaken(ground)
    assert drive.dt == frame.model.dt
    assert drive.u.shape == (478, 1)
    assert float(drive.u.abs().max()) == pytest.approx(0.1 * 9.80665, rel=1e-2)
    masses = load_pretrained("element_network/bouc_wen")
    forced = masses.shaken(ground, scale=0.5).u
    assert forced.shape == (399, 3)
    sound = torch.tensor([0.8, 2.0, 1.2]).double()  # kg, of the structure itself
    half = -0.5 * 9.80665 * torch.from_numpy(ground.a)
    torch.testing.assert_close(forced[::2], half[:, None] * sound, rtol=1e-2, atol=1e-9)
    with pytest.raises(ValueError, match="driven by neither a shaken base nor known masses"):
        load_pretrained("gru/bouc_wen").shaken(ground)
