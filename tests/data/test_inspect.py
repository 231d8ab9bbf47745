"""python -m data.inspect: what it prints, draws and writes, and how it fails."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from data.inspect.inspection import inspection, suggest


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


def test_columns_are_guessed_by_unit_and_name():
    units = {"ch1": "g", "ch2": "kN", "LVDT": "mm", "Force": "V", "Ground acc": "m/s^2"}
    columns = ["Time", "time2", *units, "Acc_X", "Temperature"]
    assert suggest(columns, units) == {
        "Time": "time", "ch1": "a1", "ch2": "f1", "LVDT": "x1", "Ground acc": "s_ddot1",
        "Acc_X": "a2",
    }  # fmt: skip
