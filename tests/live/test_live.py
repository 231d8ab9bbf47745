"""python -m live: streams equal the batch, faults end no run, the end."""

from __future__ import annotations

import io
import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from data.sample import Sensors
from live import samples
from models.online.adaptive import Online
from models.online.stream import started
from models.stored.run import read_run
from runner.config.compose import composed
from runner.folder.run import restore
from tests.experiments import estimator_from
from tests.program.planted_runs import plant
from tests.program.test_train import PLAIN, finished_run

DT = 0.01


@pytest.fixture(scope="module")
def online(tmp_path_factory) -> Path:
    words = (*PLAIN, "baselines=none", "model=online_vwnn")
    return finished_run(tmp_path_factory.mktemp("online") / "run", *words)


def estimates(path: Path | str) -> torch.Tensor:
    table = np.genfromtxt(path, delimiter=",", names=True)
    return torch.from_numpy(np.stack([table[f"estimate{i}"] for i in (1, 2, 3)], axis=1))


def near(u: torch.Tensor, v: torch.Tensor) -> bool:
    return u.shape == v.shape and bool((u - v).abs().max() < 1e-9 * v.abs().max())


# The batch, line by line


def test_lines_from_nothing_are_the_batch_from_nothing(run, lines, bilinear_record):
    status, out, _ = run("-", "--rate", "100", "--output", "made.csv", text=lines)
    assert status == 0
    assert "400 samples: relative error" in out
    record = bilinear_record.measured().window(0, 400)
    model = Online(3, record.excitation.shape[-1], DT)
    nothing = started(model.estimator, model.law, from_nothing=True)
    wanted, _ = model.follow(record, model.law, nothing)
    assert near(estimates("made.csv"), wanted)


def test_a_frozen_run_is_the_batch_to_rounding(run, online):
    words = ("test", "--run", str(online), "adaptation=frozen", "--speed", "inf")
    status, out, _ = run(*words, "--output", "made.csv")
    assert status == 0
    model, data = restored(online)
    (record,) = data.records["test"]
    wanted = model.estimates(record.measured())["frozen"]
    assert near(estimates("made.csv"), wanted)
    error = 100.0 * float((wanted - record.a).norm() / record.a.norm())
    assert f"relative error {error:.2f} %" in out


def restored(folder: Path):
    """Its model and its data."""
    stored = read_run(folder)
    data = stored.experiment.make_data()
    data.setup()
    return restore(stored), data


def test_a_run_goes_on_from_where_training_ended(run, online):
    assert run("test", "--run", str(online), "--speed", "inf", "--output", "made.csv")[0] == 0
    model, data = restored(online)
    (record,) = data.records["test"]
    assert near(estimates("made.csv"), model(record.measured()))


def test_a_shaken_frame_by_its_own_names(run):
    """A record of base excitation: replayed, and printed and read again, it is the same stream."""
    t = DT * np.arange(300)
    ground, top = np.sin(9.0 * t), np.sin(9.0 * t) + np.sin(11.0 * t + 1.0)
    table = np.column_stack([t, ground, top, 0.5 * top])
    np.savetxt(
        "frame.csv", table, delimiter=",", header="time,s_ddot1,a1,a2", comments="", fmt="%.17g"
    )
    status, out, _ = run("--replay", "frame.csv", "--speed", "inf", "--output", "one.csv")
    assert (status, "300 samples" in out) == (0, True)
    status, printed, _ = run("--replay", "frame.csv", "--speed", "inf", program=samples)
    assert (status, printed.splitlines()[0]) == (0, "t,s_ddot1,a1,a2")
    assert run("-", "--rate", "100", "--output", "two.csv", text=printed)[0] == 0
    one, two = (np.genfromtxt(p, delimiter=",", skip_header=1) for p in ("one.csv", "two.csv"))
    np.testing.assert_allclose(one[:, 1:5], two[:, 1:5], rtol=0, atol=1e-9)
    np.testing.assert_allclose(one[:, 1] + ground, top, rtol=0, atol=1e-12)


def test_a_fresh_motion_of_the_run_s_own_system(run, online):
    words = ("simulation", "--run", str(online), "data.duration=3", "--speed", "inf")
    said = [run(*words, *more)[1].splitlines()[0] for more in ((), ("seed=1",), ("seed=2",))]
    assert said[0] == said[1] != said[2]  # seed 0 was trained on
    assert "300 samples" in said[0]


# Faults


def test_bad_samples_and_lines_are_survived_and_named(run, lines):
    rows = lines.splitlines()
    rows[100] = "nonsense"
    rows[150] = rows[150].replace(",", ",,", 1).rpartition(",")[0]  # f1 is missing
    rows[200] = rows[199]
    rows[300] = rows[300].rpartition(",")[0] + ","
    status, out, _ = run("-", "--rate", "100", text="\n".join(rows))
    assert status == 0
    assert "bad lines: 1; the last: line 101: 1 cells" in out
    events = next(line for line in out.splitlines() if line.startswith("events: "))
    assert "2 dropped" in events  # the nonsense, and what came twice in its own place
    assert "1 repeated" in events
    assert "not_finite" in events
    assert "nan" not in out


def test_channels_and_events_have_the_numbers_of_their_floors(run, lines):
    rows = lines.replace("x2", "x4").replace("v2", "v4").replace("a2", "a4").splitlines()
    rows[300] = rows[300].rpartition(",")[0] + ","
    rows[301] = rows[301].rsplit(",", 2)[0] + ",nan,0.1"
    status, out, _ = run("-", "--rate", "100", "--output", "made.csv", text="\n".join(rows))
    assert (status, "not_finite, a4," in out) == (0, True)
    assert Path("made.csv").read_text().startswith("time,a1,a3,a4,estimate1,estimate3,estimate4,")


def test_nothing_in_the_input_is_executed(run, lines, tmp_path):
    target = tmp_path / "written"
    cell = f"__import__('pathlib').Path({str(target)!r}).touch()"
    rows = lines.splitlines()
    rows[50] = ",".join([cell] * len(rows[0].split(",")))
    header = rows[0] + ',"$(touch written)",`touch written`'
    # every line is two cells short, and none is usable
    assert run("-", "--rate", "100", text="\n".join([header, *rows[1:]]))[0] == 1
    assert run("-", "--rate", "100", text="\n".join(rows))[0] == 0
    assert not target.exists()
    assert not Path("written").exists()


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ([], "0 samples"),
        (["x", "0,1", "y,z,1"], "3 bad lines, the last: line 4: 'y' is no number"),
        (["0.00,,", "0.01,nan,nan"], "2 samples; events: 2 not_finite; the last: not_finite, a1"),
    ],
)
def test_a_run_without_one_sound_sample_is_no_success(run, rows, found):
    words = ("-", "--rate", "100", "--output", "made.csv")
    status, out, err = run(*words, text="\n".join(["t,f1,a1", *rows]))
    assert status == 1
    assert err.count("\n") == 1
    assert f"no valid sample arrived: {found}" in err
    assert "relative error" not in out
    assert Path("made.csv").exists() == found.startswith("2 samples")


def test_an_outlier_at_the_beginning_is_no_part_of_the_error(run, lines):
    rows = lines.splitlines()
    rows[1] = rows[1].rpartition(",")[0] + ",1e9"
    sound, hit = (run("-", "--rate", "100", text="\n".join(u)) for u in (lines.splitlines(), rows))
    assert "1 outlier; the last: outlier, a3, at 0.000 s" in hit[1]
    errors = [float(said[1].split("relative error ")[1].split()[0]) for said in (sound, hit)]
    assert errors[1] < 1.2 * errors[0]


@pytest.mark.parametrize(
    ("words", "text", "message"),
    [
        (["-", "--rate", "100"], "t,f1\n0,1\n", "expected accelerations a1"),
        (["-", "--rate", "100"], "", "the input ended before its first line"),
        (["-", "--rate", "0"], "t,f1,a1\n", "--rate 0 Hz must be positive"),
        (["-"], "t,f1,a1\n", "--rate HZ"),
        (["-", "--rate", "100", "--output", "is_there"], "t,f1,a1\n", "File exists: is_there"),
        (["-", "--rate", "100", "--sound", "3"], "t,f1,a1\n", "--sound 3 s: expected at least"),
        (["-", "--rate", "100", "--every", "0"], "t,f1,a1\n", "--every 0 s must be positive"),
        (["-", "--rate", "100", "model=vwnn"], "t,f1,a1\n", "cannot begin from nothing"),
        (["-", "--rate", "100", "model=online_linear"], "t,f1,a1\n0,1,1\n", "which the sample lac"),
        (["-", "--rate", "100", "model.cut=3"], "t,f1,a1\n", "cut"),
        (["-", "--rate", "x"], "", "invalid float value"),
        (["simulation", "-"], "", "expected one of simulation, test"),
        (["simulation", "--units", "a=g"], "", "a record takes data.units.a=g"),
        ([], "", "no source was given"),
        (["test", "--run", "nowhere"], "", "nowhere is not a finished run"),
        (["--replay", "nowhere.csv"], "", "there is no such file or folder"),
        (["simulation", "data.duration=1", "--speed", "0"], "", "--speed 0 must be positive"),
        (["--listen", "70000", "--rate", "9"], "", "expected a port"),
    ],
)
def test_bad_words_end_in_one_line(run, tmp_path, words, text, message):
    (tmp_path / "is_there").touch()
    status, _, err = run(*words, text=text)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


def test_a_run_says_what_does_not_fit(run, online, lines):
    where = ("--run", str(online))
    rows = lines.splitlines()
    fewer = "\n".join(row.rpartition(",")[0] for row in rows)
    status, _, err = run("-", *where, text=fewer)
    assert (status, "identified with 3 and" in err) == (1, True)
    status, _, err = run("-", *where, "--rate", "50", text=lines)
    assert (status, "the run every 0.01 s" in err) == (1, True)
    status, _, err = run("test", *where, "model.estimator.cutoff=10")
    assert (status, "the model is that of --run" in err) == (1, True)


# The end


class Silent(io.BytesIO):
    """Lines, and then a signal while the next one is waited for."""

    def readline(self, *size: int) -> bytes:
        if line := super().readline(*size):
            return line
        signal.raise_signal(signal.SIGINT)
        return b""


def test_a_signal_ends_the_program_while_it_waits(run, lines):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # as in the foreground
    status, out, err = run("-", "--rate", "100", "--every", "1", text=Silent(lines.encode()))
    signal.signal(signal.SIGINT, before)
    assert (status, err) == (130, "")
    assert out.startswith("t = 1.0 s, ")
    assert "relative error" in out


def test_a_run_of_other_floors_is_not_streamed(run, tmp_path):
    """As many sensors as in training, one of them on another floor, or of a force."""
    sensors = Sensors(0.01, 2, 1, "base", channels=("s_ddot1", "a2", "a5"))
    words = ("model=vwnn", "model.order=1", "model.sigmoid_weight=0.05", "data=measured")
    model = estimator_from(composed(*words, "data.path=none.csv").model, sensors)
    model.weights.data.fill_(0.0)
    folder = plant(tmp_path / "run", model, sensors, *words, "data.path=none.csv")
    t = 0.01 * np.arange(50)
    for drive, floors in (("s_ddot1", "a2,a5"), ("f1", "a2,a5"), ("s_ddot1", "a3,a5")):
        rows = np.column_stack([t, np.sin(t), np.cos(t), np.cos(t)])
        head = f"time,{drive},{floors}"
        np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=head, comments="")
        words = ("--replay", "r.csv", "--speed", "inf", "--run", str(folder), "data.units.time=s",
                 "data.units.a=g", "data.units.s_ddot=g", "data.units.f=N")  # fmt: skip
        status, _, error = run(*words)
        assert status == ((drive, floors) != ("s_ddot1", "a2,a5")), error
        assert ("the run was driven by the acceleration of its base" in error) == (drive == "f1")
    assert "the run was identified on the DOFs [2, 5], the records are of [3, 5]" in error
