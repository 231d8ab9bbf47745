"""python -m data.inspect: what it prints, draws and writes, and how it fails."""

from __future__ import annotations

import re
import shlex
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from data import Bilinear, Structure
from data.inspect.inspection import suggest
from data.inspect.proposal import proposal
from data.measured.datamodule import MeasuredData
from data.simulation.motion import simulate
from runner.config.compose import composed
from tests.data.odd_files import ODD, clock, shaken, table
from tests.experiments import data_from


@pytest.fixture
def run(inspect_run):
    return inspect_run


@pytest.fixture
def vibration(tmp_path: Path) -> Path:
    """20 s of 2.5 Hz at 100 Hz, columns that are called as ours, and a gap."""
    t = 0.01 * np.delete(np.arange(2000), slice(500, 503))
    columns = {"time": t, "f1": np.sin(5 * np.pi * t), "a1": np.cos(5 * np.pi * t)}
    return table(tmp_path / "vibration.csv", columns)


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
        (["vibration.csv", "vibration.csv", "--picture", "a.png"], "is of one record; there are 2"),
        (["vibration.csv", "--picture", "nowhere/a.png"], "nowhere"),
    ],
)
def test_bad_words_end_in_one_line(run, vibration, words, message):
    status, _, err = run(*words)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", ODD)
def test_an_odd_file_is_understood(run, tmp_path, name):
    """Whether a fit to it ends well: tests/program/test_identify_odd_files.py."""
    write, words, says = ODD[name]
    _, out, err = run(str(write(tmp_path)), *words)
    for said in says:
        assert said in out + err


def pack(name: str, *files: Path) -> None:
    with zipfile.ZipFile(name, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, f"records/{file.name}")


def test_no_picture_is_left_of_an_archive_of_two_records(run, vibration, tmp_path):
    other = tmp_path / "other.csv"
    other.write_bytes(Path("vibration.csv").read_bytes())
    pack("two.zip", Path("vibration.csv"), other)
    status, _, err = run("two.zip", "--picture", "a.png")
    assert (status, "is of one record; there are 2" in err) == (1, True)
    assert not Path("a.png").exists()


def test_events_in_other_units_are_compared_in_si(run, tmp_path):
    base, roof = shaken()
    for unit, size in (("g", 1.0), ("gal", 980.665)):
        columns = {"t [s]": clock(), f"Base [{unit}]": size * base, f"Roof [{unit}]": size * roof}
        table(tmp_path / f"in {unit}.csv", columns)
    _, out, _ = run(str(tmp_path))
    assert "times as large" not in out


def test_an_archive_of_one_file_is_told_as_that_file(run, strange):
    pack("packed.zip", strange)
    words = ("--channels", "time=Time", "a1=Acc_X", "--units", "a=g")
    for more in ((), words):
        _, out, _ = run("test 7.csv", *more)
        out = out.replace('"test 7.csv"', "packed.zip").replace("test 7.csv", "packed.zip")
        out = out.replace("'data.path=packed.zip'", "data.path=packed.zip")
        assert run("packed.zip", *more) == (0, out, "")


def test_columns_are_guessed_by_unit_and_name():
    units = {"ch1": "g", "ch2": "kN", "LVDT": "mm", "Force": "V", "Ground acc": "m/s^2"}
    columns = ["Time", "time2", *units, "Acc_X", "Temperature"]
    assert suggest(columns, units) == {
        "Time": "time", "ch1": "a1", "LVDT": "x1", "Ground acc": "s_ddot1", "Acc_X": "a2",
    }  # fmt: skip


# A command that is ready


def ready(out: str, tmp_path: Path) -> MeasuredData:
    """The data of the command that was proposed, unedited."""
    words = shlex.split(out[out.rindex("python train.py") :])[2:]
    return data_from(composed(*words))


COLUMNS = {
    "free": ({"time [s]": 0.01, "x1 [m]": None, "v1 [m/s]": None, "a1 [m/s^2]": None},
             "model=element_network"),
    "free, accelerations": ({"time [s]": 0.01, "a1 [g]": None},
                            "model=element_network model/reads=accelerations"),
    "frame": ({"time [s]": 0.01, "Table acc. [g]": None, "Roof \"E\" acc [g]": None},
              "model=element_network model/reads=accelerations"),
    "building": ({"time [s]": 0.01, "Ground [g]": None, "Floor1 [g]": None, "Roof [g]": None},
                 "model=element_network model.laws=named model.from_accelerations=true"),
    "element without a clock": ({"Stroke (mm)": None, "Load (kN)": None}, "model=element_test"),
}  # fmt: skip


@pytest.mark.parametrize("name", COLUMNS)
def test_the_command_that_is_proposed_is_ready_and_its_model_a_structure(run, tmp_path, name):
    columns, model = COLUMNS[name]
    t = 0.01 * np.arange(800)
    motion = 0.1 * np.exp(-0.4 * t) * np.cos(12.0 * t)
    if not name.startswith("free"):
        motion = np.sin(3.0 * t) * np.sin(0.4 * t) * np.sin(11.0 * t)
    quoted = {'"{}"'.format(c.replace('"', '""')): t if s else motion for c, s in columns.items()}
    table(Path("a b.csv"), quoted)
    status, out, _ = run("a b.csv")
    assert status == 0
    assert out.rstrip().endswith(model)
    assert ("free vibration" in out) == name.startswith("free")
    storeys = 2 if name == "building" else 1
    assert f"likely storeys: {storeys}" in out or name.startswith("element")
    data = ready(out, tmp_path)
    assert data.dofs == storeys
    assert data.inputs == (0 if name.startswith("free") else 2 if "element" in name else 1)


@pytest.mark.parametrize(
    ("floors", "least"), [(("Floor 6", "Roof"), 6), (("2F", "RF"), 0), (("1F", "2F", "RF"), 0),
                          (("3rd Fl", "9th Fl"), 8)],
)  # fmt: skip
def test_floors_without_a_sensor_are_told_by_names_and_get_modes(run, tmp_path, floors, least):
    """A chain of laws has a sensor on each floor; an American 1st floor may be the ground."""
    t = 0.01 * np.arange(800)
    motion = np.sin(3.0 * t) * np.sin(0.4 * t) * np.sin(11.0 * t)
    sensors = {f"{name} [g]": (1.1 + 0.1 * i) * motion for i, name in enumerate(floors)}
    table(Path("floors.csv"), {"time [s]": t, "Ground [g]": motion, **sensors})
    _, out, _ = run("floors.csv")
    assert out.rstrip().endswith("model=modal_network") == (least > 0)
    assert (f"storeys: {least} at least" in out) == (least > 0)
    assert ready(out, tmp_path).dofs == len(floors)
    advice = [line for line in out.splitlines() if "number channels by floors: " in line]
    assert len(advice) == (least > 0)
    for line in advice:
        setting, *model = shlex.split(line.partition(": ")[2])[:3]
        assert model == ["model=element_network", "model.laws=named"]
        data = data_from(composed("data=measured", "data.path=floors.csv", setting, *model))
        assert data.numbers == ([6, 7] if "Roof" in floors else [3, 9])


@pytest.mark.parametrize("seed", range(3))
def test_sensors_on_some_floors_keep_their_numbers_and_raise_no_doubts(run, seed):
    """Floors 2 and 5 of five, on a base that shakes; then the roof is pushed, or floor 3 is."""
    rng, t = np.random.default_rng(seed), 0.01 * np.arange(4000)
    chain = {
        f"r{i}": Bilinear(
            between=(f"x{i - 1}" if i > 1 else "s1", f"x{i}"), stiffness=k, damping=0.003 * k,
            post_yield_stiffness=0.2 * k, yield_displacement=0.01,
        )
        for i, k in enumerate(2000.0 * np.exp(rng.uniform(-0.3, 0.3, 5)), start=1)
    }  # fmt: skip
    frame = Structure([1.0] * 5, chain)
    smooth = lfilter([1.0, -1.0], [1.0, -0.95], rng.standard_normal((2, 4000)))
    ground, push = lfilter([1.0], [1.0, -0.6], smooth)
    rate = 0.01 * np.cumsum(ground)[:, None]
    cases = {"": ("s_ddot1", None), "Force [N]": ("f5", 4), "Force": ("f1", 2)}
    for name, (channel, floor) in cases.items():
        force, shaken = np.zeros((4000, 5)), float(floor is None)
        if floor is not None:
            force[:, floor] = push
        a = simulate(frame, force, 0.01, 0.01 * shaken * rate.cumsum(axis=0), shaken * rate).a
        drive = {name or "s_ddot1 [m/s^2]": push if name else ground}
        table(Path("t.csv"), {"t [s]": t, **drive, "a2 [m/s^2]": a[:, 1], "a5 [m/s^2]": a[:, 4]})
        _, out, _ = run("t.csv", "--units", "f=N")
        assert "no faults found" in out
        assert "storeys: 5 at least" in out
        found = proposal(["t.csv"], {}, {"f": "N"})
        assert found.columns.keys() - {"time"} == {channel, "a2", "a5"}
        asked = [option for _, option in found.questions]
        assert asked == (["data.channels.f1=COLUMN"] if floor == 2 else [])  # it has no sensor


def test_a_column_that_is_called_as_a_channel_keeps_its_number_beside_said_ones(tmp_path):
    t = np.arange(20.0)
    columns = {"t [s]": 0.01 * t, "q": t % 3, "a2 [g]": t % 5, "a5 [g]": t % 7}
    path = table(tmp_path / "t.csv", columns)
    found = proposal([str(path)], {"f5": "q"}, {"f": "N"})
    assert found.columns == {"time": "t", "f5": "q", "a2": "a2", "a5": "a5"}


def test_the_first_modes_are_the_strongest_of_the_response(run):
    """Two storeys in free vibration, 2 and 5.2 Hz: their peaks are told, weakest last."""
    t = 0.01 * np.arange(4000)
    one, two = (np.exp(-0.1 * t) * np.cos(2.0 * np.pi * f * t) for f in (2.0, 5.2))
    floors = {"a1 [m/s^2]": one + 0.4 * two, "a2 [m/s^2]": 1.6 * one - 0.25 * two}
    table(Path("two.csv"), {"time [s]": t, **floors})
    _, out, _ = run("two.csv")
    found = re.search(r"response is strongest at ([\d.]+), ([\d.]+) Hz: its first modes", out)
    assert found is not None
    assert [float(f) for f in found.groups()] == pytest.approx([2.0, 5.2], abs=0.06)
    assert "likely storeys: 2, one for each sensor" in out


def test_a_broad_peak_is_told_where_no_peak_stands_out(run):
    """A storey of 1.9 Hz and 15 % damping under white forces; a sensor of half its motion."""
    dt, omega, zeta = 0.01, 2.0 * np.pi * 1.9, 0.15
    rng = np.random.default_rng(5)
    pole = np.exp((-zeta + 1j * np.sqrt(1.0 - zeta**2)) * omega * dt)
    x = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=6000))
    base = {"time [s]": dt * np.arange(6000), "s_ddot1 [m/s^2]": rng.normal(size=6000)}
    table(Path("broad.csv"), {**base, "a1 [m/s^2]": x, "a2 [m/s^2]": 0.5 * x})
    _, out, _ = run("broad.csv")
    found = re.search(r"response is strongest at ([\d.]+) Hz", out)
    assert found is not None
    assert 1.4 < float(found[1]) < 2.3


def test_columns_beside_named_channels_are_guessed_where_channels_alone_do_not_do(run):
    """t, ag, a1: the ground is none of our names; with s_ddot1 the names alone are taken."""
    t = 0.01 * np.arange(800)
    motion = np.sin(3.0 * t) * np.sin(0.4 * t)
    for name, guessed in (("ag [m/s^2]", True), ("s_ddot1 [m/s^2]", False)):
        table(Path("t.csv"), {"t [s]": t, name: motion, "a1 [m/s^2]": 1.1 * motion})
        _, out, _ = run("t.csv")
        assert ("s_ddot1: ag" in out) == guessed
        assert "model=element_network model/reads=accelerations" in out


def test_the_way_of_a_whole_test_is_no_load_beside_it():
    """A testing machine's axial force moves its axial displacement; a column's load does not."""
    units = {"Axial Displacement": "mm", "Axial Force": "N"}
    assert suggest(list(units), units) == {"Axial Displacement": "s1", "Axial Force": "r1"}
    units = {"Drift": "mm", "Lateral Force": "kN", "Axial Force": "kN"}
    assert suggest(list(units), units) == {
        "Drift": "s1",
        "Lateral Force": "r1",
        "Axial Force": "u1",
    }


def test_a_base_shear_drives_nothing_and_a_drift_is_no_motion_of_a_floor():
    """Of a wall under an imposed drift it is the deformation."""
    units = {"Table acc": "m/s^2", "Floor1 acc": "m/s^2", "Base shear": "kN", "Drift 1": "mm"}
    assert suggest(list(units), units) == {"Table acc": "s_ddot1", "Floor1 acc": "a1"}
    assert suggest(["Load", "Drift"], {"Load": "kN", "Drift": "mm"}) == {
        "Load": "r1",
        "Drift": "s1",
    }


def test_a_force_acts_on_the_floor_that_its_name_counts():
    units = {"Force 2 [N]": "N", "Acc 1": "g", "Acc 2": "g"}
    assert suggest(list(units), units)["Force 2 [N]"] == "f2"
    assert suggest(list(units)[:2], units)["Force 2 [N]"] == "f1"  # two has no sensor


def test_a_force_without_a_floor_is_asked_for_where_it_must_be_corrected(run, tmp_path):
    noise = np.random.default_rng(3).standard_normal((3, len(clock())))
    columns = {"t [s]": clock(), "Hammer [N]": noise[0], "Acc 1 [g]": noise[1]}
    table(tmp_path / "hammer.csv", columns | {"Acc 2 [g]": noise[2]})
    _, out, _ = run("hammer.csv")
    assert "must be corrected: on which floor does 'Hammer' act" in out


def test_a_mass_that_yields_under_a_force_is_no_element_test(tmp_path):
    """One force, one displacement, one acceleration: a mass takes part of the force, or none."""
    spring = Bilinear(
        between=("ground", "x1"), yield_displacement=0.01, stiffness=40.0, post_yield_stiffness=6.0,
        damping=0.3,
    )  # fmt: skip
    force = np.random.default_rng(0).standard_normal((300, 1)).repeat(10, axis=0)
    motion = simulate(Structure([1.0], {"r": spring}), force, 0.01)
    units = {"Load": "N", "Disp": "m", "Acc": "m/s^2"}
    of_mass = {"Load": force[:, 0], "Disp": motion.x[:, 0], "Acc": motion.a[:, 0]}
    assert suggest(list(units), units, values=of_mass)["Load"] == "f1"
    of_element = of_mass | {"Load": motion.r[:, 0]}
    for columns in (list(units), list(units)[:2]):
        assert suggest(columns, units, values=of_mass)["Load"] == "f1"
        assert suggest(columns, units, values=of_element)["Load"] == "r1"
        turned = of_element | {"Load": -motion.r[:, 0]}
        assert suggest(columns, units, values=turned)["Load"] == "r1"
    rng = np.random.default_rng(1)
    for values, load, share in ((of_mass, "f1", 1.0), (of_element, "r1", 0.3)):  # noise in motion
        noise = {c: share * u.std() * rng.standard_normal(len(u)) for c, u in values.items()}
        noisy = values | {c: values[c] + noise[c] for c in ("Disp", "Acc")}
        assert suggest(list(units), units, values=noisy)["Load"] == load
    names = []  # of files that disagree, all together decide
    for name, values, T in (("p.csv", of_mass, 3000), ("q.csv", of_element, 300)):
        columns = np.column_stack([0.01 * np.arange(T), *(u[:T] for u in values.values())])
        head = ",".join(["Time [s]", *(f"{c} [{unit}]" for c, unit in units.items())])
        np.savetxt(tmp_path / name, columns, delimiter=",", header=head, comments="")
        names.append(str(tmp_path / name))
    assert proposal(names[1:], {}, {}).columns["r1"] == "Load"
    together = {"time": "Time", "f1": "Load", "x1": "Disp", "a1": "Acc"}
    assert proposal(names, {}, {}).columns == together


def test_a_clock_that_jitters_is_interpolated_and_not_replaced(tmp_path):
    """Of a fault with two remedies the first: data.dt would shift what the stamps say."""
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(400) + 0.002 * rng.uniform(-1.0, 1.0, 400)
    path = table(tmp_path / "j.csv", {"time": t, "f1": np.sin(20 * t), "a1": np.cos(20 * t)})
    words = proposal([str(path)], {}, {}).words
    assert [w for w in words if "mend" in w or "dt" in w] == ["data.mend.resample=100"]


def test_a_slow_column_that_is_no_channel_slows_no_other_down(tmp_path):
    """A temperature once a second beside a base and a roof; its rate is a repair of nothing."""
    base, roof = shaken()
    slow = np.full(len(base), np.nan)
    slow[1::100] = 20.0 + np.arange(len(slow[1::100]))
    columns = {"Temperature [C]": slow, "time": clock(), "Base [g]": base, "Roof [g]": roof}
    found = proposal([str(table(tmp_path / "t.csv", columns))], {}, {})
    assert found.columns == {"time": "time", "s_ddot1": "Base", "a1": "Roof"}
    assert found.mends == [] == found.questions


@pytest.mark.parametrize("said", [{}, {"a1": "Roof"}, {"s_ddot1": "Base", "a1": "Roof"}])
def test_a_reversed_sensor_keeps_the_unit_of_its_column(said, tmp_path):
    """Whoever names the columns: −g of a column in g, and not −m/s² of what was made of it."""
    base, roof = shaken()
    columns = {"time": clock(), "Base [g]": base / 9.80665, "Roof [g]": -roof / 9.80665}
    found = proposal([str(table(tmp_path / "r.csv", columns))], said, {})
    assert 'data.units.a1="-g"' in found.words


@pytest.mark.parametrize("named", [False, True])
def test_an_answer_leaves_the_rest_as_it_was_recognised(named, tmp_path):
    """Whichever column a person names as it is guessed anyway: no floor and no clock is lost."""
    base, roof = shaken()
    names = {"time": "Time [s]", "s_ddot1": "Base [g]", "a1": "Floor 1 [g]", "a2": "Floor 2 [g]"}
    columns = {"time": clock(), "s_ddot1": base, "a1": 0.6 * roof, "a2": roof}
    called = {c if named else names[c]: u for c, u in columns.items()}
    path = str(table(tmp_path / "r.csv", called))
    rest = {c: c if named else names[c].partition(" [")[0] for c in columns}
    for channel in ("s_ddot1", "a1", "a2"):
        found = proposal([path], {channel: rest[channel]}, {})
        assert found.columns == rest, channel
        assert not found.questions
    if not named:  # the others' numbers give way
        assert proposal([path], {"a1": "Floor 2"}, {}).columns["a2"] == "Floor 1"


def test_a_clock_without_two_times_is_a_fault_and_no_warning(tmp_path):
    path = tmp_path / "n.json"
    path.write_text('{"time": [0, NaN, Infinity], "f1": [1, 2, 3], "a1": [1, 2, 3]}')
    (question, _), *_ = proposal([str(path)], {}, {}).questions
    assert "times are missing" in question
