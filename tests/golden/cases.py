"""Short cases whose numbers are kept to the last bit: one function a case, through public doors.

A case returns {label: number, list of numbers, or text}. The labels are this file's own, so that
the kept values outlive a renamed key, a moved module and another layout of files: what they cost
then is a line of the tables below.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from hydra.core.global_hydra import GlobalHydra

import evaluate
import predict
import train
from data import Drive, Record
from models.zoo import list_pretrained, load_pretrained

Values = dict[str, Any]

# ------------------------------------------------------------------ names that may change
SETTINGS = {  # a model: the words that choose it, and what makes it short
    "power_series_residual": ("model=power_series_residual",),
    "chebyshev_restoring_force": ("model=chebyshev_restoring_force",),
    "residual_mlp": ("model=residual_mlp", "solver.iterations=15"),
    "global_mlp": ("model=global_mlp", "solver.iterations=15"),
    "linear": ("model=linear",),
    "gru": ("model=gru", "solver.iterations=3", "model.hidden=8"),
    "neural_state_space": (
        "model=neural_state_space", "solver.iterations=2", "objective.horizons=[50]",
    ),
    "vwnn_forward": ("model=vwnn_forward", "model.refinements=1"),
    "modal_network": (
        "model=modal_network", "model.modes=3", "model.elements=1", "model.laws=[cubic]",
        "model.directions=4", "model.draws=1", "model.iterations=3",
    ),
    "latent_hysteresis_network": (
        "model=latent_hysteresis_network", "model.elements=4", "objective.starts=2",
        "objective.start_iterations=2", "objective.horizons=[1,20]", "solver.iterations=3",
    ),
    "units": (
        "model=element_network", "objective.starts=2", "objective.finalists=1",
        "objective.start_iterations=2", "objective.horizons=[1,null]", "solver.iterations=3",
    ),
    "branch": (
        "model=element_network_branch", "model.law_starts=1", "model.ramps=2", "model.bends=1",
        "model.prior=1e-9", "model.force_memory=false", "model.unsymmetric=false",
        "solver.iterations=3", "system=single_oscillator",
    ),
    "named": (
        "model=element_network_named", "model.laws=[MenegottoPinto]", "system=single_oscillator",
    ),
    "unit_element": (
        "model=hysteretic_element", "objective.starts=2", "objective.start_iterations=2",
        "objective.finalists=1", "objective.select=[]", "solver.iterations=5",
    ),
    "branch_element": (
        "model=branch_element", "model.law_starts=1", "model.ramps=3", "model.bends=1",
        "model.prior=1e-9", "model.force_memory=false", "model.unsymmetric=false",
        "solver.iterations=5",
    ),
    "named_element": ("model=named_element", "model.laws=[MenegottoPinto]"),
    "sliders": ("model=prandtl_ishlinskii",),
    "surface": ("model=restoring_force_surface",),
}  # fmt: skip
ELEMENT_TESTS = ("unit_element", "branch_element", "named_element", "sliders", "surface")
ONE_STEP = {"train": "train", "test": "test"}  # label: key of metrics.json
FREE_RUN = {"free_run_train": "free_run_train", "free_run_test": "free_run"}
ERRORS = {"error": "relative_rms_percent", "per_dof": "per_dof_percent"}
QUICK = ("figures=false", "trainer.enable_progress_bar=false", "data.calibration_records=0")


# ------------------------------------------------------------------ commands, in this process
@contextmanager
def _apart(*words: str) -> Iterator[io.StringIO]:
    """A command line in this process; what it prints comes back and is not shown."""
    said = io.StringIO()
    GlobalHydra.instance().clear()
    given = mock.patch.object(sys, "argv", list(words))
    stop = suppress(SystemExit)  # also of a run whose few iterations identified nothing
    with given, redirect_stdout(said), redirect_stderr(said), stop:
        yield said


def command(program: Any, *words: str) -> str:
    """What `python program.py words` prints."""
    with _apart(f"{program.__name__}.py", *words) as said:
        program.cli()
    return said.getvalue()


def module_command(name: str, *words: str) -> str:
    """What `python -m name words` prints."""
    with _apart(name, *words) as said:
        runpy.run_module(name, run_name="__main__")
    return said.getvalue()


def trained(folder: Path, *words: str) -> dict[str, Any]:
    """metrics.json of `python train.py words`, with baselines where the words ask for some."""
    none = () if any(word.startswith("baselines=") for word in words) else ("baselines=none",)
    quick = QUICK[: 2 if "data=measured" in words else 3]
    said = command(train, *none, *quick, *words, f"hydra.run.dir={folder}")
    if not (folder / "metrics.json").is_file():
        raise RuntimeError(f"train.py {' '.join(words)} did not finish: {said[-2000:]}")
    return json.loads((folder / "metrics.json").read_text("utf-8"))


def errors(metrics: dict[str, Any], keys: dict[str, str] = ONE_STEP | FREE_RUN) -> Values:
    """Errors in percent by split, in total and of each DOF."""
    return {
        f"{split} {label}": metrics[key][error]
        for split, key in keys.items()
        if key in metrics
        for label, error in ERRORS.items()
        if error in metrics[key]
    }


def fit(*words: str) -> Values:
    """Errors of a run in a folder that goes away."""
    with tempfile.TemporaryDirectory() as folder:
        return errors(trained(Path(folder), *words))


def array(values: Any) -> Values:
    """An array: the hash of its bytes, its Euclidean norm, and eight of its values."""
    flat = np.ascontiguousarray(values, dtype=np.float64).ravel()
    places = np.linspace(0, flat.size - 1, 8).astype(int)
    return {
        "sha256": hashlib.sha256(flat.tobytes()).hexdigest(),
        "norm": float(np.sqrt((flat * flat).sum())),
        "some": flat[places].tolist(),
    }


def numbers_of(path: Path) -> np.ndarray:
    """The numbers of a CSV, columns in the order of their names."""
    with path.open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    return table[:, np.argsort(head)]


# ------------------------------------------------------------------ records
def wave(samples: int, dt: float, *frequencies: float) -> np.ndarray:
    """Sines of these frequencies [rad/s] that swell and fade, by plain Python's arithmetic."""
    t = dt * np.arange(samples)
    envelope = 4.0 * t / t[-1] * (1.0 - t / t[-1])
    return envelope * sum(np.sin(w * t + w * w) / (1.0 + 0.1 * w) for w in frequencies)


def write_csv(path: Path, dt: float, **columns: np.ndarray) -> Path:
    t = dt * np.arange(len(next(iter(columns.values()))))
    lines = [",".join(["time", *columns])]
    for row in zip(t, *columns.values(), strict=True):
        lines.append(",".join(f"{value:.9g}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_cyclic_test(path: Path) -> Path:
    """An element test, s1 [m] and r1 [N]: a spring of 400 N/m and a slider of 500 N/m, 6 N."""
    s = 0.03 * wave(1200, 0.01, 1.9, 4.3)
    slider, force = 0.0, []
    for before, now in zip(np.append(0.0, s[:-1]), s, strict=True):
        slider = min(max(slider + 500.0 * (now - before), -6.0), 6.0)
        force.append(400.0 * now + slider)
    return write_csv(path, 0.01, s1=s, r1=np.array(force))


def write_oscillator(path: Path) -> Path:
    """A hardening oscillator: f1 [N] and a1 [g], by the semi-implicit Euler rule."""
    dt, f = 0.01, 3.0 * wave(2000, 0.01, 2.1, 4.7, 7.9, 11.3)
    x = v = 0.0
    a = np.zeros(len(f))
    for k, force in enumerate(f):
        a[k] = force - 0.8 * v - 60.0 * x - 4000.0 * x**3
        v += dt * a[k]
        x += dt * v
    return write_csv(path, dt, f1=f, a1=a / 9.80665)


# ------------------------------------------------------------------ cases
def vwnn() -> Values:
    """The VWNN on the paper's bilinear system, beside the usual baselines."""
    with tempfile.TemporaryDirectory() as folder:
        metrics = trained(Path(folder), "baselines=usual", "data.duration=20")
    rows = {
        f"{name}: {label}": value
        for name, row in metrics["baselines"].items()
        for label, value in errors(row).items()
    }
    return errors(metrics) | rows


def vwnn_noisy() -> Values:
    """The VWNN where states are integrated from noisy accelerations."""
    return fit("scenario=noisy_integrated", "data.duration=20", "seed=3")


def model(name: str) -> Values:
    """A model of SETTINGS on 10 s of the bilinear system, or of another that they name."""
    return fit("data.duration=10", *SETTINGS[name])


def element_test(name: str) -> Values:
    """A model of SETTINGS on a measured element test."""
    with tempfile.TemporaryDirectory() as folder:
        record = write_cyclic_test(Path(folder) / "test.csv")
        return fit("data=measured", f"data.path={record}", *SETTINGS[name])


def structures() -> Values:
    """The motions of structures whose laws have a memory of their own: a linear model's errors."""
    found: Values = {}
    for system in ("steel_frame", "self_centering_frame", "timber_house", "slack_braced_frame",
                   "isolated_building", "bridge_piers", "polynomial", "bouc_wen"):  # fmt: skip
        own = fit("data.duration=5", "model=linear", f"system={system}")
        found |= {f"{system}: {label}": value for label, value in own.items()}
    return found


def online() -> Values:
    """An on-line VWNN on one pass of 20 s, an element damaged on the way."""
    words = ("model=online_vwnn", "damage=sudden", "damage.time=10", "data.duration=20")
    return fit(*words)


def published() -> Values:
    """The free run of one published model of each kind under a fixed motion, from rest."""
    newest: dict[str, str] = {}
    for entry in list_pretrained():
        newest.setdefault(entry["name"].partition("/")[0], entry["name"])
    return {
        f"{kind}: {label}": value
        for kind, name in newest.items()
        for label, value in array(_response(name)).items()
    }


@torch.no_grad()
def _response(name: str, samples: int = 400) -> np.ndarray:
    """x, v and a of a published model, or its estimates where it has no free run."""
    pretrained = load_pretrained(name)
    net, dt = pretrained.model, pretrained.model.dt
    largest = pretrained.metrics["trained_range"]["excitation"]["largest"]
    columns = [
        0.5 * size * wave(samples, dt, 3.0 + k, 7.0 + 2.0 * k) for k, size in enumerate(largest)
    ]
    u = torch.from_numpy(np.stack(columns, axis=1))
    rest = torch.zeros(net.dofs, dtype=torch.float64)
    try:
        motion = net.free_run(Drive(dt, u, rest, rest))
    except ValueError:  # has no free run
        still = torch.zeros(samples, net.dofs, dtype=torch.float64)
        return net(Record(dt, a=still, f=u, x=still, v=still)).numpy()
    return torch.cat([motion.x, motion.v, motion.a], dim=-1).numpy()


def exported() -> Values:
    """C steps of published models: their text, and the motion that gcc makes of them."""
    found: Values = {}
    for name in ("element_network/bouc_wen", "vwnn/bilinear", "gru/bilinear"):
        with tempfile.TemporaryDirectory() as folder:
            words = (f"run=zoo:{name}", "to=c", f"output={folder}")
            said = module_command("export", *words)
            kind = name.partition("/")[0]
            source = Path(folder) / f"{kind}.c"
            if not source.is_file():
                raise RuntimeError(f"python -m export {' '.join(words)}: {said[-2000:]}")
            found[f"{name}: text"] = _text(source.read_text("utf-8"))
            if shutil.which("gcc"):
                found[f"{name}: motion"] = array(_run_c(Path(folder), kind))
    return found


def _text(source: str) -> str:
    """The hash of a C source without its comments, where the day and the version stand."""
    code = re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL)
    return hashlib.sha256(" ".join(code.split()).encode()).hexdigest()


def _run_c(folder: Path, name: str) -> np.ndarray:
    files = [str(folder / f"{name}.c"), str(folder / f"{name}_main.c")]
    flags = ["-std=c99", "-O1", "-ffp-contract=off"]
    subprocess.run(["gcc", *flags, *files, "-lm", "-o", str(folder / "run")], check=True)
    force = {f"f{k + 1}": wave(300, 0.01, 3.0 + k, 7.0 + k) for k in range(3)}
    motion = folder / "motion.csv"
    with write_csv(folder / "u.csv", 0.01, **force).open() as u, motion.open("w") as out:
        subprocess.run([str(folder / "run")], stdin=u, stdout=out, check=True)
    return numbers_of(motion)


def predicted() -> Values:
    """predict.py of a published model under a generated motion, and one from a file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record = write_csv(folder / "u.csv", 0.01, s_ddot1=2.0 * wave(500, 0.01, 3.0, 7.0, 17.0))
        motions = {
            "generated": ("excitation.seed=5", "excitation.duration=5"),
            "file": (f"excitation.path={record}",),
        }
        found: Values = {}
        for label, words in motions.items():
            given = ("run=zoo:element_network/bouc_wen", "figures=false", *words)
            said = command(predict, *given, f"output={folder / label}")
            histories = sorted((folder / label).rglob("history.csv"))
            if not histories:
                raise RuntimeError(f"predict.py {' '.join(given)}: {said[-2000:]}")
            found[label] = array(numbers_of(histories[0]))
    return found


def laplace() -> Values:
    """Parameters of a fitted network and their intervals, by evaluate.py uncertainty=laplace."""
    with tempfile.TemporaryDirectory() as name:
        run = Path(name) / "run"
        words = ("system=single_oscillator", "scenario=noisy", "data.duration=10")
        trained(run, *SETTINGS["units"], *words)
        said = command(evaluate, f"run={run}", "uncertainty=laplace", "figures=false")
        files = sorted(run.rglob("uncertainty.json"))
        if not files:
            raise RuntimeError(f"evaluate.py uncertainty=laplace: {said[-2000:]}")
        content = json.loads(files[0].read_text("utf-8"))
    return {
        f"{p['name']}: {label}": p[label]
        for p in content["parameters"]
        for label in ("value", "half", "white", "model_error")
        if label in p
    }


def measured() -> Values:
    """A measured record: what data.inspect finds in it, and a VWNN of it, mended and in g."""
    with tempfile.TemporaryDirectory() as name:
        record = write_oscillator(Path(name) / "record.csv")
        said = module_command("data.inspect", str(record), "units.a=g")
        mended = ("data.units.a=g", "data.mend.low_pass=20", "data.mend.detrend=mean")
        found = fit("data=measured", f"data.path={record}", *mended)
    plain = re.findall(r"(?<![\w.])-?\d+\.\d+", said.replace(str(record), ""))
    return found | {"inspected": sorted(set(map(float, plain)))}  # how often, is the page's own


CASES: dict[str, Callable[[], Values]] = {
    "vwnn": vwnn,
    "vwnn_noisy": vwnn_noisy,
    "online": online,
    "structures": structures,
    "published": published,
    "exported": exported,
    "predicted": predicted,
    "laplace": laplace,
    "measured": measured,
    **{name: partial(element_test, name) for name in ELEMENT_TESTS},
    **{name: partial(model, name) for name in SETTINGS if name not in ELEMENT_TESTS},
}
