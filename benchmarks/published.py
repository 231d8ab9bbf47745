"""How do published packages do on the zoo's records, in the free run that the zoo is scored by?

    python -m benchmarks.published                  # seeds 40–47, 8 records; some hours
    python -m benchmarks.published --packages sindy --seeds 40 --models linear element_network
    python -m benchmarks.published --quick          # 10 s of motion, one record, 5 s a fit

deepSI's SUBNET (a neural state space with an encoder), SysIdentPy's polynomial NARX (terms by FROLS
and BIC, a model per DOF) and PySINDy (sparse regression by STLSQ) get the forces and the measured
motion of the same training records, with their defaults or the settings of their examples, and
simulate the acceleration of an unseen record from rest. Prints median, smallest and largest error
over the seeds [%], and how many runs diverged or failed. A fit of `subnet` ends after --seconds of
the processor. The packages want an environment of their own: pip install -e '.[published]'.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from importlib.util import find_spec
from os import devnull
from statistics import median
from typing import Any
from unittest import mock

import numpy as np
import torch
from scipy.interpolate import interp1d

from benchmarks.fitting import fit as fit_zoo
from benchmarks.table import show
from data.arguments import Parser
from data.record import Drive, Record
from models.experiment import Experiment
from runner.config.choices import plain
from runner.config.command_line import command_errors
from runner.config.compose import composed

Simulator = Callable[[Drive], np.ndarray]  # accelerations (T, n) from rest
ESCAPE = 100.0  # times the record's largest acceleration: a free run beyond has diverged
HELD_BACK = 0.2  # of every record, its end: for choices that a package leaves to its user
LAGS = (1, 2, 5, 10, 15, 20)  # of narx, samples
SYSTEMS = ("bilinear", "polynomial", "bouc_wen")


def at_rest(signal: np.ndarray, samples: int) -> np.ndarray:
    """A signal (T, c) after some samples at rest."""
    return np.concatenate([np.zeros((samples, signal.shape[1])), signal])


def subnet(records: list[Record], seed: int, seconds: float) -> Simulator:
    """deepSI: 12 states, 20 past samples, sections of 50; the best on held-back motion is kept."""
    dsi, past = import_module("deepSI"), 20
    signals = [[at_rest(u.numpy(), past) for u in (r.f, r.a)] for r in records]
    dt = records[0].dt
    whole = [dsi.Input_output_data(f, a, sampling_time=dt) for f, a in signals]
    first = round((1.0 - HELD_BACK) * records[0].samples)
    train, validation = [w[:first] for w in whole], [w[first:] for w in whole]
    torch.manual_seed(seed)
    shape = {"nx": 12, "na": past, "nb": past, "feedthrough": True}  # a force is felt at once
    model = dsi.SUBNET(*dsi.get_nu_ny_and_auto_norm(train), **shape)
    end = time.process_time() + seconds

    def loss(*arguments: Any) -> torch.Tensor:  # the package's `fit` ends by an interrupt
        if time.process_time() > end:
            raise KeyboardInterrupt
        return dsi.fitting.compute_NMSE(*arguments)

    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(dsi.fitting, "get_checkpoint_dir", return_value=folder),
        open(devnull, "w") as nowhere,
        redirect_stdout(nowhere),
        redirect_stderr(nowhere),
    ):
        settings = {"T": 50, "batch_size": 64, "val_freq": 100, "loss_fun": loss}
        dsi.fit(model, train, validation, n_its=10**9, **settings)

    @torch.no_grad()
    def simulate(drive: Drive) -> np.ndarray:
        u = at_rest(drive.u.numpy(), past)
        rest = np.zeros((len(u), model.ny))
        return model.simulate(dsi.Input_output_data(u, rest, sampling_time=drive.dt)).y[past:]

    return simulate


def narx(records: list[Record], seed: int, seconds: float) -> Simulator:
    """SysIdentPy: degree 2, BIC over up to 39 terms, on the rows that lie in one record."""
    frols = import_module("sysidentpy.model_structure_selection").FROLS
    basis = import_module("sysidentpy.basis_function").Polynomial
    estimation = import_module("sysidentpy.parameter_estimation").LeastSquares
    rest = max(LAGS)
    within = np.concatenate([np.arange(r.samples) >= rest for r in records])[rest:]

    class FROLS(frols):  # type: ignore[misc, valid-type]
        def run_mss_algorithm(self, psi: np.ndarray, y: np.ndarray, terms: int) -> tuple:
            """Terms for BIC are ranked once: the first of a greedy choice are those of a longer."""
            if not hasattr(self, "ranked"):
                self.rows, self.target = psi[within], y[self.max_lag :][within]
                target = np.concatenate([y[: self.max_lag], self.target])
                self.ranked = self.error_reduction_ratio(self.rows, target, self.n_info_values)
            err, order, _ = self.ranked
            return err, order[:terms], self.rows[:, order[:terms]], self.target

    def present(f: np.ndarray) -> np.ndarray:
        """Forces a sample early: the package's lags begin at 1, an acceleration's force at 0."""
        return np.concatenate([f[1:], f[-1:]])

    f, a = (np.concatenate(u) for u in zip(*((present(r.f.numpy()), r.a.numpy()) for r in records),
                                           strict=True))  # fmt: skip
    lags = [list(LAGS)] * f.shape[1] if f.shape[1] > 1 else list(LAGS)
    models = [
        FROLS(
            order_selection=True, info_criteria="bic", n_info_values=39, xlag=lags,
            ylag=list(LAGS), estimator=estimation(), basis_function=basis(degree=2),
        ).fit(X=f, y=a[:, i : i + 1])
        for i in range(a.shape[1])
    ]  # fmt: skip

    def simulate(drive: Drive) -> np.ndarray:
        u, start = present(at_rest(drive.u.numpy(), rest)), np.zeros((rest, 1))
        return np.concatenate([m.predict(X=u, y=start)[rest:] for m in models], axis=1)

    return simulate


def sindy(records: list[Record], seed: int, seconds: float) -> Simulator:
    """PySINDy: degree 3 of scaled x, v and f; the threshold that is best on held-back motion."""
    ps, dofs, dt = import_module("pysindy"), records[0].dofs, records[0].dt
    assert all(r.x is not None and r.v is not None for r in records)
    states = [np.concatenate([r.x, r.v], axis=1) for r in records]
    rates = [np.concatenate([r.v, r.a], axis=1) for r in records]
    forces = [r.f.numpy() for r in records]
    size, push = (np.sqrt(np.mean(np.concatenate(u) ** 2, axis=0)) for u in (states, forces))
    x, x_dot, u = [s / size for s in states], [r / size for r in rates], [f / push for f in forces]
    limit, first = ESCAPE * np.abs(np.concatenate(x)).max(), round((1.0 - HELD_BACK) * len(x[0]))

    def fit(threshold: float, part: slice) -> Any:
        library, optimizer = ps.PolynomialLibrary(degree=3), ps.STLSQ(threshold=threshold)
        model = ps.SINDy(optimizer=optimizer, feature_library=library)
        signals = {"x_dot": [d[part] for d in x_dot], "u": [f[part] for f in u]}
        return model.fit([s[part] for s in x], t=dt, **signals)

    def states_of(model: Any, start: np.ndarray, u: np.ndarray) -> np.ndarray:
        """States (T, 2n) by the package's `simulate`; those after an escape are infinite."""
        t = dt * np.arange(len(u))
        force = interp1d(t, u, axis=0, bounds_error=False, fill_value=(u[0], u[-1]))
        escape = lambda t, q: limit - np.abs(q).max()
        escape.terminal = True  # type: ignore[attr-defined]
        solver = {"method": "LSODA", "rtol": 1e-6, "atol": 1e-6, "events": escape}
        run = model.simulate(start, t, u=force, integrator_kws=solver)
        return np.pad(run, ((0, len(u) - len(run)), (0, 0)), constant_values=np.inf)

    def held_back_error(threshold: float) -> float:
        model = fit(threshold, slice(first))
        pairs = zip(x, u, strict=True)
        ends = (states_of(model, s[first], f[first:]) - s[first:] for s, f in pairs)
        return sum(float(np.sum(end**2)) for end in ends)

    model = fit(min((1.0, 0.3, 0.1, 0.03), key=held_back_error), slice(None))

    def simulate(drive: Drive) -> np.ndarray:
        f, start = drive.u.numpy() / push, np.concatenate([drive.x0.numpy(), drive.v0.numpy()])
        run = states_of(model, start / size, f)
        known = np.isfinite(run).all(axis=1)
        a = np.full((len(run), dofs), np.inf)
        a[known] = (model.predict(run[known], u=f[known]) * size)[:, dofs:]
        return a

    return simulate


PACKAGES: dict[str, tuple[str, Callable[[list[Record], int, float], Simulator]]] = {
    "subnet": ("deepSI", subnet), "narx": ("sysidentpy", narx), "sindy": ("pysindy", sindy)
}  # fmt: skip


def error_of(name: str, system: str, seed: int, sizes: Sequence[str], seconds: float) -> float:
    """Relative RMS error of the free run on the test record [%]; infinite where it diverged."""
    experiment = Experiment.of(plain(composed(f"system={system}", f"seed={seed}", *sizes)))
    data = experiment.set_up_data()
    train, (test, *_) = data.records["train"], data.records["test"]
    with warnings.catch_warnings(), torch.no_grad(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of the packages
        try:
            if name in PACKAGES:
                with torch.enable_grad():
                    simulate = PACKAGES[name][1](list(train), seed, seconds)
                estimate = simulate(test.drive())
            else:
                with torch.enable_grad():
                    model, _ = fit_zoo([f"model={name}", f"seed={seed}"], train)
                estimate = model.free_run(test.drive()).a.numpy()
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):  # such as a loss that is NaN
            return math.inf
    a = test.a.numpy()
    lost = not np.isfinite(estimate).all() or np.abs(estimate).max() > ESCAPE * np.abs(a).max()
    return math.inf if lost else 100.0 * float(np.linalg.norm(a - estimate) / np.linalg.norm(a))


def rows(names: Sequence[str], seeds: Sequence[int], sizes: Sequence[str], seconds: float
         ) -> Iterator[list[object]]:  # fmt: skip
    for system in SYSTEMS:
        for name in names:
            errors = [error_of(name, system, seed, sizes, seconds) for seed in seeds]
            numbers = (f"{number:.2f}" for number in (median(errors), min(errors), max(errors)))
            yield [f"{system}, {name}", *numbers, sum(map(math.isinf, errors))]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add, names = parser.add_argument, list(PACKAGES)
    add("--packages", nargs="*", metavar="NAME", default=names, choices=names, help=str(names))
    add("--models", nargs="*", default=["linear"], help="estimators of the zoo, see conf/model")
    add("--records", type=int, default=8, help="training motions")
    add("--seeds", nargs="+", type=int, default=list(range(40, 48)))
    add("--seconds", type=float, default=120.0, help="of the processor, for a fit of subnet")
    add("--quick", action="store_true", help="10 s of motion, one record and seed, 5 s a fit")
    options = parser.parse_args()
    missing = [p for name in options.packages if find_spec(p := PACKAGES[name][0]) is None]
    if missing:
        raise ValueError(f"{', '.join(missing)}: not installed; pip install -e '.[published]', or "
                         "leave out with --packages")  # fmt: skip
    sizes = [f"data.train_records={options.records}"]
    if options.quick:
        sizes, options.seeds = ["data.train_records=1", "data.duration=10"], [40]
        options.seconds = 5.0
    torch.set_num_threads(1)
    head = ("free run, error [%]", "median", "smallest", "largest", "lost")
    names = [*options.packages, *options.models]
    show("", head, rows(names, options.seeds, sizes, options.seconds))


if __name__ == "__main__":
    with command_errors():
        main()
