"""python -m data.inspect: what it prints, draws and writes, and how it fails."""

from __future__ import annotations

import zipfile
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from omegaconf import OmegaConf

from data.inspect import __main__ as command_line
from data.inspect.config import config_path
from data.inspect.guesses import suggest
from data.inspect.inspection import inspection, places
from data.inspect.picture import COLUMNS, envelope


@pytest.fixture
def run(inspect_run):
    return inspect_run


@pytest.fixture
def vibration(tmp_path: Path) -> Path:
    """20 s of 2.5 Hz at 100 Hz, columns that are called as ours, and a gap."""
    t = 0.01 * np.delete(np.arange(2000), slice(500, 503))
    rows = np.column_stack((t, np.sin(5 * np.pi * t), np.cos(5 * np.pi * t)))
    path = tmp_path / "vibration.csv"
    np.savetxt(path, rows, delimiter=",", header="time,f1,a1", comments="")
    return path


@pytest.fixture
def strange(tmp_path: Path) -> Path:
    """Ten lines with names that nobody can be sure of."""
    rows = [f"{0.01 * i:.2f};{i % 3};{0.1 * i:.3f};{-i}" for i in range(9)]
    path = tmp_path / "test 7.csv"
    path.write_text("\n".join(["Time [s];Hammer [kN];Acc_X;${oc.env:HOME}", *rows]) + "\n")
    return path


def test_ten_lines_are_understood(run, strange):
    status, out, err = run("test 7.csv")
    assert (status, err) == (0, "")
    assert "'Time' is taken for the clock, in s, by its name" in out
    assert "clock: dt = 0.01 s (100 Hz), jitter 0.00%, 9 samples" in out
    assert "--channels time=Time f1=Hammer a1=Acc_X" in out
    assert not list(strange.parent.glob("*.png"))  # nothing is written unasked


def test_clock_channels_and_faults_are_told(run, vibration):
    status, out, _ = run("vibration.csv")
    assert status == 0
    assert "a1       m/s^2     -1        1" in out
    assert "2.5" in out
    assert "must be corrected: dropped samples: 1 gap of 3 samples (0.03 s) after 4.99 s" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing.csv"], "missing.csv does not exist"),
        (["vibration.csv", "--channels", "a1"], "expected name=value"),
        (["vibration.csv", "--channels", "a1=Acc"], "no column 'Acc'"),
        (["vibration.csv", "--units", "a=kg"], "another dimension"),
        (["vibration.csv", "--frequency"], "--frequency; see --help"),
        (["vibration.csv", "--skip-rows", "x"], "invalid int value"),
        ([], "the following arguments are required: record"),
        (["vibration.csv", "vibration.csv", "--config"], "are of one record; there are 2"),
        (["vibration.csv", "--picture", "nowhere/a.png"], "nowhere"),
    ],
)
def test_bad_words_end_in_one_line(run, vibration, words, message):
    status, _, err = run(*words)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


def test_interrupted_in_silence(run, vibration, monkeypatch):
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command_line, "inspections", interrupt)
    assert run("vibration.csv") == (130, "", "")


def test_a_folder_is_every_file_in_it(run, vibration, strange):
    (vibration.parent / "LICENSE.txt").write_text("This is no table.\nNor is this, at all.\n")
    (vibration.parent / "photo.jpg").write_bytes(b"\xff\xd8")
    status, out, _ = run(".")
    assert status == 0
    assert "vibration.csv" in out
    assert "test 7.csv" in out
    assert "left out: LICENSE.txt" in out
    assert "photo" not in out
    assert run("vib*.csv")[1].count("vibration.csv") == 1


def test_records_of_a_folder_that_differ_in_rate_or_unit_are_told_in_a_line(run, tmp_path):
    t = 0.01 * np.arange(1000)
    for name, step, size in (
        ("one", 1, 1.0),
        ("slow", 2, 1.0),
        ("twice", 1, 2.0),
        ("x_g", 1, 981.0),
    ):
        rows = np.column_stack((t, np.cos(3.0 * t), size * np.sin(3.0 * t)))[::step]
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="time,f1,a1", comments="")
    lines = [line for line in run(".")[1].splitlines() if " differ: " in line]
    assert len(lines) == 2
    assert "slow.csv and one.csv differ: other rates, 50 Hz and 100 Hz" in lines[0]
    assert "x_g.csv and one.csv differ: times as large: a1 981" in lines[1]


def test_sensors_in_files_of_their_own(run, tmp_path):
    for name, late in (("one", 0.0), ("two", 0.254)):
        t = 0.01 * np.arange(400) + late
        rows = np.column_stack((t, np.sin(9.0 * t)))
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,Acc", comments="")
    words = ["--channels", "time=t", "a1=one.csv:Acc", "a2=two.csv:Acc", "--config"]
    status, out, _ = run(".", *words)
    assert status == 0
    assert "clock of a2: dt = 0.01 s" in out
    assert "sensors out of sync: first samples at a1 0 s, a2 0.254 s" in out
    (config,) = tmp_path.glob("configs/data/*.yaml")
    assert "#   resample: 100" in config.read_text()


def test_the_picture_shows_every_channel(run, vibration):
    assert run("vibration.csv", "--picture", "seen.png")[0] == 0
    image = matplotlib.image.imread("seen.png")[..., :3]
    height = image.shape[0] // 2
    for half in (image[:height], image[height:]):
        assert (half.min(axis=-1) < 0.5).mean() > 0.005  # lines, beside the paper
    assert run("vibration.csv", "--picture", "seen.png")[0] == 1


def test_the_config_holds_the_mapping_and_the_remedies(run, strange):
    words = ["test 7.csv", "--delimiter", ";", "--units", "f=kN", "--config", "mine"]
    channels = ["--channels", "time=Time", "f1=Hammer", "a1=${oc.env:HOME}"]
    status, out, _ = run(*words, *channels)
    assert status == 0
    assert "python train.py --config-dir mine data=test_7 model=vwnn scenario=integrated" in out
    text = Path("mine/data/test_7.yaml").read_text()
    data = OmegaConf.to_container(OmegaConf.create(text), resolve=True)["data"]
    assert data == {
        "path": str(strange),
        "channels": {"time": "Time", "f1": "Hammer", "a1": "${oc.env:HOME}"},
        "units": {"f": "kN"},
        "delimiter": ";",
    }
    reader = {"delimiter": data["delimiter"]}
    again = inspection(Path(data["path"]), data["channels"], data["units"], **reader)
    assert list(again.raw.channels) == ["f1", "a1"]
    status, _, err = run(*words, *channels)
    assert status == 1
    assert "exists; --force" in err


def pack(name: str, *files: Path) -> None:
    with zipfile.ZipFile(name, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, f"records/{file.name}")


def test_an_archive_of_one_file_is_told_as_that_file(run, strange):
    pack("packed.zip", strange)
    words = ("--channels", "time=Time", "a1=Acc_X", "--units", "a=g")
    for more in ((), words):
        _, out, _ = run("test 7.csv", *more)
        assert run("packed.zip", *more) == (0, out.replace("test 7.csv", "packed.zip"), "")


def test_an_archive_without_records_or_in_pieces_is_one_line(run, tmp_path):
    (tmp_path / "notes.pdf").write_text("%PDF")
    pack("packed.zip", tmp_path / "notes.pdf")
    status, out, err = run("packed.zip")
    assert (status, out) == (1, "")
    assert err.startswith("error: packed.zip holds no file of .")
    Path("packed.zip").write_bytes(b"PK")
    status, out, err = run("packed.zip")
    assert (status, out) == (1, "")
    assert err.startswith("error: packed.zip is damaged: ")


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ("configs", "configs/data/run_3.yaml"),
        ("configs/data/mine.yaml", "configs/data/mine.yaml"),
        ("mine.yaml", "data/mine.yaml"),
    ],
)
def test_configs_lie_where_hydra_looks(tmp_path, monkeypatch, wanted, found):
    monkeypatch.chdir(tmp_path)  # a folder that is not called data
    assert config_path(wanted, Path("run 3.csv")) == Path(found)


def test_columns_are_guessed_by_unit_and_name():
    units = {"ch1": "g", "ch2": "kN", "LVDT": "mm", "Force": "V", "Ground acc": "m/s^2"}
    columns = ["Time", "time2", *units, "Acc_X", "Temperature"]
    assert suggest(columns, units) == {
        "Time": "time", "ch1": "a1", "ch2": "f1", "LVDT": "x1", "Ground acc": "s_ddot1",
        "Acc_X": "a2",
    }  # fmt: skip


def test_levels_are_places_and_a_stuck_sensor_is_no_channel():
    base = np.random.default_rng(0).standard_normal(50)
    values = {"Table": base, "L1": 2.0 * base, "L2": np.full(50, 0.012), "Roof": 3.0 * base}
    guesses = suggest(list(values), {}, values=values)
    assert guesses == {"Table": "s_ddot1", "L1": "a1", "Roof": "a2"}


def test_a_folder_of_folders_and_archives_is_inspected(tmp_path):
    for event in ("one", "two"):
        (tmp_path / event).mkdir()
        with zipfile.ZipFile(tmp_path / event / "motion.zip", "w") as archive:
            archive.writestr("motion.csv", "time,a1\n0.0,1.0\n0.1,2.0\n")
    assert [p.parent.name for p, _ in places([str(tmp_path)], {})] == ["one", "two"]
    (empty := tmp_path / "none").mkdir()
    with pytest.raises(ValueError, match="and its folders hold no file"):
        places([str(empty)], {})


def test_the_envelope_of_a_long_record_keeps_its_peaks():
    signal = np.zeros(COLUMNS * 50)
    signal[[123, 4567]] = 5.0, -7.0
    signal[90_000] = np.nan
    low, high, width = envelope(signal)
    assert width == 50
    assert (np.nanmax(high), np.nanmin(low)) == (5.0, -7.0)
    assert np.isnan(low).sum() == 1
