"""Public benchmarks from prepared folders: official splits, held-out samples, errors, measures."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from scipy.io import savemat

from data.public.benchmarks import BENCHMARKS, F16
from data.public.datamodule import BenchmarkData
from data.public.series import in_band_rms, noise_floor
from data.simulation.scenario import FullState
from models.fit.metrics import Scores
from runner.config.compose import composed
from runner.job import identify
from runner.scores.outcome import benchmark_lines
from tests.experiments import data_from
from tests.hostile_files import Bomb

# Prepared folders of public benchmarks, of random numbers in the official layouts
ARCHIVES = {  # whose presence tells the package that nothing is to be downloaded
    "silverbox": "Silverbox/SilverboxFiles.zip",
    "f16": "F16/F16GVT_Files.zip",
}
PERIOD, NOISE = 8192, 7e-6


def contents(name: str) -> dict[str, dict[str, np.ndarray]]:
    """Random signals under the names and in the shapes of the official files."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal
    files = BENCHMARKS[name].files
    if name == "silverbox":
        return {files[0]: {"V1": noise((1, 127500)), "V2": noise((1, 127500))}}
    if name == "f16":
        sizes = {f: 300 if "FullMSine" in f else 400 for f in F16}
        rate = {"Fs": np.array([[400.0]])}
        return {
            f: {"Force": noise((1, T)), "Voltage": noise((1, T)), "Acceleration": noise((3, T))}
            | rate
            for f, T in sizes.items()
        }
    u, y = 50.0 * noise(PERIOD), 7e-4 * noise(PERIOD)
    repeated = np.tile(y, 4) + NOISE * noise(4 * PERIOD)
    return {files[0]: {"u": np.tile(u, 4)[None]}, files[1]: {"y": repeated[None]}}


def prepare(folder: Path, files: dict[str, dict[str, np.ndarray]]) -> None:
    for path, variables in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        savemat(folder / path, variables, do_compression=False)


def as_version_7_3(place: Path, variables: dict[str, np.ndarray]) -> None:
    """A MAT file of version 7.3: HDF5 behind a block of 512 bytes, rows and columns exchanged."""
    with h5py.File(place, "w", userblock_size=512) as file:
        for name, value in variables.items():
            file[name] = value.T


def as_table(place: Path, variables: dict[str, np.ndarray]) -> None:
    """The CSV of an archive: numbered columns, a sampling rate in the first row alone."""
    columns = {}
    for name, value in variables.items():
        value = value if len(value) >= value.shape[1] else value.T
        width = value.shape[1]
        columns |= {f"{name}{i + 1}" if width > 1 else name: value[:, i] for i in range(width)}
    rows = max(map(len, columns.values()))
    cells = [[repr(float(x)) for x in c] + [""] * (rows - len(c)) for c in columns.values()]
    lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    place.with_suffix(".csv").write_text("\n".join(lines) + "\n")


def loaded(name: str, folder: Path, **more: object) -> BenchmarkData:
    return BenchmarkData(name, FullState(), folder=str(folder), **more)


def prepared(name: str, folder: Path, **more: object) -> BenchmarkData:
    data = loaded(name, folder, **more)
    data.setup()
    return data


def ours(data: BenchmarkData, split: str) -> list[tuple[np.ndarray, np.ndarray, int]]:
    return [(r.f.numpy(), r.a.numpy(), r.warmup) for r in data.make_records()[split]]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All benchmarks as the package would have left them."""
    folder = tmp_path_factory.mktemp("benchmarks")
    for name in BENCHMARKS:
        prepare(folder, contents(name))
    for archive in ARCHIVES.values():
        (folder / archive).touch()
    return folder


def test_silverbox_has_the_packages_splits(folder):
    package = pytest.importorskip("nonlinear_benchmarks", reason="extra `benchmarks` not installed")
    official = package.Silverbox(
        dir_placement=str(folder), atleast_2d=True, always_return_tuples_of_datasets=True
    )
    series = BENCHMARKS["silverbox"].read(loaded("silverbox", folder).files)
    for mine, theirs in zip(series, official, strict=True):
        for one, other in zip(mine.values(), theirs, strict=True):
            np.testing.assert_array_equal(one.f, other.u)
            np.testing.assert_array_equal(one.a, other.y)
            assert one.dt == pytest.approx(float(other.sampling_time), rel=1e-12)
            window = other.state_initialization_window_length
            assert window == one.warmup or (mine is series[0] and window is None)


@pytest.mark.parametrize("split", [0, 1])
def test_f16_has_the_packages_splits_with_all_three_outputs(split, folder):
    package = pytest.importorskip("nonlinear_benchmarks", reason="extra `benchmarks` not installed")
    mine = BENCHMARKS["f16"].read(loaded("f16", folder).files)[split]
    for i in range(3):
        theirs = package.F16(output_index=i, dir_placement=str(folder))[split]
        assert len(mine) == len(theirs) == (8, 6)[split]
        for (name, one), other in zip(mine.items(), theirs, strict=True):
            assert name in other.name
            np.testing.assert_array_equal(one.a[:, i], other.y)
            np.testing.assert_array_equal(one.f[:, 0], other.u)
            assert one.warmup == other.state_initialization_window_length


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_prepared_folder_needs_neither_package_nor_network(name, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
    data = prepared(name, folder, download=name != "bouc_wen")
    about = BENCHMARKS[name]
    for record in data.records["train"] + data.records["test"]:
        assert (record.dofs, record.dt) == (data.dofs, data.dt)
        assert (record.quantity, record.hold) == (about.quantity, about.hold)
    assert data.dofs == (3 if name == "f16" else 1)
    assert data.unit
    assert (data.sensors.quantity, data.sensors.units["y1"]) == (about.quantity, about.unit)
    assert (data.noise is None) == (name != "bouc_wen")


@pytest.mark.parametrize(("name", "layout"), [("silverbox", "7.3"), ("f16", "csv")])
def test_other_layouts_hold_the_same_series(name, layout, folder, tmp_path):
    write = as_version_7_3 if layout == "7.3" else as_table
    for path, variables in contents(name).items():
        write(tmp_path / Path(path).name, variables)
    other, known = loaded(name, tmp_path), loaded(name, folder)
    for split in ("train", "test"):
        for one, two in zip(ours(other, split), ours(known, split), strict=True):
            np.testing.assert_array_equal(one[0], two[0])
            np.testing.assert_array_equal(one[1], two[1])
    assert other.dt == pytest.approx(known.dt, rel=1e-12)


@pytest.mark.parametrize("damage", ["cut", "text", "pickle", "empty", "other", "cells", "short"])
def test_a_damaged_file_is_one_line(damage, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path("SNLS80mV.mat")
    names = ("V1", "V2")
    if damage == "cut":
        whole = (folder / "Silverbox/SilverboxFiles/SNLS80mV.mat").read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
    elif damage in ("text", "empty"):
        path.write_text("<html>try later</html>" * 20 if damage == "text" else "")
    elif damage == "pickle":
        path.write_bytes(pickle.dumps(Bomb()))
    elif damage == "other":
        savemat(path, {"a": np.zeros(3)})
    elif damage == "cells":
        savemat(path, {n: np.array([[{"a": 1}, "b"]], dtype=object) for n in names})
    else:
        savemat(path, {n: np.zeros((300, 1)) for n in names})
    with pytest.raises(ValueError, match=r"SNLS80mV\.mat|silverbox: ") as error:
        loaded("silverbox", tmp_path)
    assert "\n" not in str(error.value)


def test_a_folder_may_hold_the_series_that_are_asked_for_alone(tmp_path):
    """Each file of the F-16 is a series: those of other series need not be there."""
    files = contents("f16")
    here = [f for f in files if "FullMSine_Level1" in f or "FullMSine_Level2" in f]
    prepare(tmp_path, {f: files[f] for f in here})
    asked = {"train": "FullMSine_Level1", "test": ["FullMSine_Level2"]}
    data = loaded("f16", tmp_path, **asked)
    assert [*data.series["train"], *data.series["test"]] == [
        "FullMSine_Level1", "FullMSine_Level2",
    ]  # fmt: skip
    for missing in ({"train": "*_Level3"}, {"test": "SineSw_Level4"}, {"calibration": "*_Level5"}):
        with pytest.raises(ValueError, match=r"f16: F16Data_\w+\.mat.* not in"):
            loaded("f16", tmp_path, **(asked | missing))


def test_the_initialisation_window_is_not_counted(folder):
    data = prepared("silverbox", folder)
    for split in ("train", "test"):
        (batch,) = data.loader(split)
        assert batch.warmup == 50


def test_the_metric_is_the_packages(folder):
    metrics = pytest.importorskip(
        "nonlinear_benchmarks.error_metrics", reason="extra `benchmarks` not installed"
    )
    record = loaded("silverbox", folder).make_records()["test"][0]
    estimate = 0.9 * record.a
    estimate[: record.warmup] += 7.0  # where nothing counts
    theirs = metrics.RMSE(record.a.numpy(), estimate.numpy(), n_init=record.warmup)
    ours = Scores()
    ours.add(record, {"": estimate})
    np.testing.assert_allclose(ours.percent()["per_dof_rms"], theirs, rtol=1e-12)


def test_the_held_out_period_is_not_trained_on(folder):
    data = prepared("bouc_wen", folder)
    train, test = data.records["train"], data.records["test"]
    assert [len(train), len(test)] == [3, 1]
    assert all(not torch.equal(r.a, test[0].a) for r in train)
    whole = contents("bouc_wen")[BENCHMARKS["bouc_wen"].files[1]]["y"].reshape(4, PERIOD)
    np.testing.assert_array_equal(test[0].a[:, 0].numpy(), whole[3])
    for seen in ("period_4", "start_4", "*"):
        names = {"train": [seen], "test": ["period_4"]}
        with pytest.raises(ValueError, match="test series period_4 has samples"):
            loaded("bouc_wen", folder, **names)


def test_the_end_of_a_period_can_be_held_out_of_all_periods(folder):
    data = loaded("bouc_wen", folder, train=["start_*"], test=["end_4"])
    seen = data.make_records()["train"][0].samples
    (test,) = data.make_records()["test"]
    assert (seen, test.warmup, test.initial_state) == (6144, 6144, "periodic")


def test_series_for_bands_are_neither_trained_on_nor_tested(folder):
    chosen = {"train": "period_1", "test": "period_4"}
    held = loaded("bouc_wen", folder, **chosen, calibration="period_[23]")
    held.setup()
    loader = held.calibration_loader()
    assert loader is not None
    assert sum(len(batch.a) for batch in loader) == 2
    with pytest.raises(ValueError, match="calibration series period_4 has samples of test series"):
        loaded("bouc_wen", folder, **chosen, calibration="period_[34]")
    with pytest.raises(ValueError, match="neither trained on nor tested"):
        prepared("bouc_wen", folder).calibration_loader()


def test_the_command_line_names_the_benchmark(folder, tmp_path):
    cfg = composed(
        "data=benchmark", "data.name=f16", f"data.folder={folder}", "model=vwnn_first_order",
        "baselines=none", "figures=false", "trainer.enable_progress_bar=false",
    )  # fmt: skip
    data = data_from(cfg)
    assert (data.name, data.dofs, len(data.series["train"])) == ("f16_benchmark", 3, 8)
    metrics = identify(cfg, tmp_path)
    of_it, whole = metrics["benchmark"]["in_band_rms"]["one step"], metrics["test"]["per_dof_rms"]
    assert metrics["benchmark"]["unit"] == "m/s²"
    assert all(0.0 < band < 1.01 * all_of_it for band, all_of_it in zip(of_it, whole, strict=True))
    assert any(line.startswith("of it between") for line in benchmark_lines(metrics["benchmark"]))
    assert metrics["system"] == "f16_benchmark"
    assert len(metrics["test"]["per_dof_percent"]) == 3
    assert metrics["paper"] == {}


@pytest.mark.parametrize("samples", [1000, 1001])
def test_in_band_rms_sees_a_sinusoid_in_its_band_alone(samples):
    dt, cycles = 0.01, 40  # a whole number, so that nothing leaks
    frequency = cycles / (samples * dt)
    t = dt * np.arange(samples)
    error = np.stack([3.0 * np.sin(2 * np.pi * frequency * t), np.full(samples, 2.0)], axis=1)
    near, far = (frequency - 1.0, frequency + 1.0), (frequency + 1.0, frequency + 2.0)
    np.testing.assert_allclose(in_band_rms(error, dt, near), [3.0 / np.sqrt(2.0), 0.0], atol=1e-9)
    np.testing.assert_allclose(in_band_rms(error, dt, far), [0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(in_band_rms(error, dt, (0.0, 1.0)), [0.0, 2.0], atol=1e-9)
    noise = np.random.default_rng(0).standard_normal((samples, 2))
    rms = np.sqrt((noise**2).mean(axis=0))
    np.testing.assert_allclose(in_band_rms(noise, dt, (0.0, 50.0)), rms, rtol=1e-12)
    with pytest.raises(ValueError, match="must rise"):
        in_band_rms(noise, dt, (2.0, 1.0))


def test_noise_floor_of_repeated_periods(folder):
    rng = np.random.default_rng(0)
    signal, stds = rng.standard_normal((1, 4000, 2)), np.array([0.1, 0.02])
    periods = signal + stds * rng.standard_normal((4, 4000, 2))
    floor = noise_floor(periods)
    np.testing.assert_allclose(floor, stds, rtol=0.03)
    np.testing.assert_allclose(noise_floor(np.repeat(signal, 3, axis=0)), [0.0, 0.0], atol=1e-15)
    assert noise_floor(signal) is None
    np.testing.assert_allclose(loaded("bouc_wen", folder).noise, [NOISE], rtol=0.03)


def test_a_stretch_begins_in_an_unknown_motion_at_a_place_that_the_seed_draws(folder):
    places = set()
    for seed in (0, 0, 1):
        data = loaded("bouc_wen", folder, samples=500, seed=seed)
        (record,) = data.make_records()["train"]
        places.update(data.series["train"])
        assert (record.samples, record.warmup, record.initial_state) == (500, 100, "unknown")
    assert len(places) == 2
    with pytest.raises(ValueError, match=r"data\.samples=9000: expected from 20 to 8192"):
        loaded("bouc_wen", folder, samples=9000)


def test_a_benchmark_s_folder_is_recognised_by_its_files(inspect_run, tmp_path):
    """The command that data.inspect proposes names the benchmark and its folder."""
    prepare(tmp_path / "files", contents("bouc_wen"))
    status, out, _ = inspect_run(str(tmp_path / "files"))
    assert status == 0
    words = out.rstrip().splitlines()[-1].removeprefix("    python train.py ").split()
    assert "data.name=bouc_wen" in words
    assert data_from(composed(*words)).unit == "m"
    (tmp_path / "files" / BENCHMARKS["bouc_wen"].files[0]).unlink()
    assert "public benchmark" not in inspect_run(str(tmp_path / "files"))[1]
