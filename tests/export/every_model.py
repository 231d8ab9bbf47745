"""A model of every kind, of any size, small: identified on a short record, or set by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import torch

from data.record import Drive, Record
from models.estimator import Estimator
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion
from models.mlp import GlobalMLP, ResidualMLP
from models.modal_network import ModalNetwork
from models.neural_state_space import NeuralStateSpace
from models.polynomial import ModalPolynomial
from models.prandtl_ishlinskii import PrandtlIshlinskii
from models.recurrent import Recurrent
from models.restoring_force_surface import RestoringForceSurface
from models.vwnn import VWNN
from models.vwnn_forward import ForwardVWNN

DT = 0.01


def drive(dofs: int, inputs: int, samples: int = 200, hold: str = "linear") -> Drive:
    """A smooth excitation of both signs that has a jump, from a state in motion."""
    generator = torch.Generator().manual_seed(dofs)
    white = torch.randn(samples, inputs, generator=generator, dtype=torch.float64)
    u = white.cumsum(dim=0) / samples**0.5
    u += torch.sin(0.2 * torch.arange(samples, dtype=torch.float64))[:, None] - u.mean(dim=0)
    u[samples // 2 :] += 0.5
    x0, v0 = 0.02 * torch.randn(2, dofs, generator=generator, dtype=torch.float64)
    return Drive(DT, u, x0, v0, hold)


def chain(dofs: int, inputs: int | None = None, samples: int = 400, cubic: float = 40.0) -> Record:
    """Masses in a row on springs that may stiffen, under forces, by small explicit steps."""
    m, rng = dofs if inputs is None else inputs, np.random.default_rng(dofs)
    f = np.cumsum(rng.standard_normal((samples, m)), axis=0) / 4.0
    f += 10.0 * rng.standard_normal(f.shape)
    into = np.eye(dofs) if m == dofs else rng.standard_normal((dofs, m))
    into = np.ones((dofs, 1)) if m == 1 else into
    x, v, history = np.zeros(dofs), np.zeros(dofs), []
    for u in f:
        stretch = np.diff(np.r_[0.0, x], append=x[-1])
        rate = np.diff(np.r_[0.0, v], append=v[-1])
        force = 90.0 * stretch + cubic * stretch**3 + 1.5 * rate
        a = into @ u + np.diff(force)
        history.append((x, v, a))
        v = v + DT * a
        x = x + DT * v
    x, v, a = (torch.from_numpy(np.stack(s)) for s in zip(*history, strict=True))
    return Record(DT, a, torch.from_numpy(f), x, v)


def imposed(samples: int = 200) -> Drive:
    """A slow deformation that goes back and forth, and its rate."""
    t = DT * torch.arange(samples, dtype=torch.float64)
    s = 0.02 * torch.sin(9.0 * t) * (0.2 + t) + 0.004 * torch.sin(31.0 * t)
    rest = torch.zeros(1, dtype=torch.float64)
    return Drive(DT, torch.stack([s, torch.gradient(s, spacing=DT)[0]], dim=1), rest, rest)


def element_test() -> Record:
    """An element whose force stiffens, and forgets nothing of a slider."""
    u = imposed(400).u
    s, rate = u.split(1, dim=1)
    z = torch.zeros(1, dtype=torch.float64)
    slid = []
    for ds in torch.diff(s, dim=0, prepend=s[:1]):
        z = (z + ds).clamp(-0.005, 0.005)
        slid.append(z)
    r = 50.0 * s + 4e3 * s**3 + 0.7 * rate + 200.0 * torch.stack(slid)
    return Record(DT, r, u[:, :0], s=s, s_dot=rate, quantity="force")


def differences(
    model: Estimator, given: Drive, outputs: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """Of each output of a model's step from its free run, over its largest."""
    with torch.inference_mode():
        whole, loops = model.run_with_loops(given)
    wanted = {"x": whole.x, "v": whole.v, "a": whole.a, "r": whole.a, "output": whole.a}
    if loops is not None:
        wanted |= {"y": loops[0], "deformation": loops[0], "r": loops[1]}
    found = {}
    for name, signal in outputs.items():
        right = wanted[name].numpy()
        assert np.isfinite(right).all()
        found[name] = float(np.abs(signal - right).max() / max(np.abs(right).max(), 1e-300))
    return found


def agrees_with(found: np.ndarray, wanted: torch.Tensor, tolerance: float) -> None:
    """Whether two signals differ by less than a share of the largest."""
    right = wanted.detach().numpy()
    assert np.isfinite(right).all()
    assert np.abs(found - right).max() <= tolerance * np.abs(right).max()


def drawn(model: Estimator, size: float = 1.0) -> Estimator:
    """Weights drawn anew, so that none is nil."""
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weights in model.parameters():
            other = torch.randn(weights.shape, generator=generator, dtype=weights.dtype)
            weights.copy_(size * other / max(weights.shape[-1], 1) ** 0.5)
    return model


def linear(dofs: int) -> Estimator:
    model = EquivalentLinear(dofs, dofs, DT)
    model.identify([chain(dofs)])
    return model


def linear_base(dofs: int) -> Estimator:
    model = EquivalentLinear(dofs, 1, DT)
    model.identify([chain(dofs, 1)])
    return model


def linear_motion(dofs: int) -> Estimator:
    model = LinearMotion(dofs, dofs, DT)
    model.identify([replace(chain(dofs), x=None, v=None)])
    return model


def recurrent(dofs: int, layers: int, states: bool = True, inputs: int = 2) -> Estimator:
    torch.manual_seed(dofs)
    record = chain(dofs, inputs)
    model = Recurrent(dofs, inputs, DT, hidden=4, layers=layers)
    model.identify([record if states else replace(record, x=None, v=None)])
    return model


def vwnn(dofs: int, inputs: int, **choices) -> Estimator:
    return drawn(VWNN(dofs, inputs, DT, **choices), 2.0)


def vwnn_forward(dofs: int, inputs: int, **choices) -> Estimator:
    record = chain(dofs, inputs, 300)
    model = ForwardVWNN(dofs, inputs, DT, refinements=0, ridge=1e-3, **choices)
    model.identify([record])
    return model


def mlp(dofs: int, kind: type[GlobalMLP | ResidualMLP], inputs: int, **choices) -> Estimator:
    """A network that is a small part of a damped linear motion."""
    torch.manual_seed(dofs)
    model = kind(dofs, inputs, DT, **choices)
    model.identify([chain(dofs, inputs)])
    with torch.no_grad():
        model.network.output_scale.reach.fill_(0.5)
    return model


def polynomial(dofs: int, **choices) -> Estimator:
    """The series of a linear motion, and a little of every term beside."""
    model = ModalPolynomial(dofs, dofs, DT, ridge=1e-6, **choices)
    model.identify([chain(dofs, samples=800, cubic=0.0)])
    generator = torch.Generator().manual_seed(dofs)
    with torch.no_grad():
        for weights in model.coefficients:
            size = 1e-3 * weights.abs().max().clamp_min(1.0)
            weights += size * torch.randn(weights.shape, generator=generator, dtype=weights.dtype)
    return model


def neural_state_space(dofs: int, inputs: int) -> Estimator:
    """The equivalent linear system, with networks and an encoder of some effect."""
    model = NeuralStateSpace(dofs, inputs, DT, memory=3, hidden=4, past=3)
    model.identify([chain(dofs, inputs)])
    generator = torch.Generator().manual_seed(dofs)
    with torch.no_grad():
        for weights in (model.encoder.weight, model.step.outer.weight, model.output.outer.weight):
            weights += 0.05 * torch.randn(weights.shape, generator=generator, dtype=torch.float64)
        for bias in (model.step.inner.bias, model.step.outer.bias, model.output.outer.bias):
            bias += 0.01
    return model


def modal(outputs: int, inputs: int, elements: int, substeps: int = 3) -> Estimator:
    """Modes, and elements with all that a law can have."""
    rng, J = np.random.default_rng(outputs), max(2, outputs)
    model = ModalNetwork(outputs, inputs, DT, modes=J, elements=elements)
    model.counts.copy_(torch.tensor([J, elements, substeps, 1]))
    model.theta.data.fill_(0.0)
    layout = model.layout
    parts = {name: 0.3 * rng.standard_normal(s) for name, s in layout.shapes.items()}
    parts["log_k"], parts["log_c"] = np.linspace(-1.0, 2.0, J), np.full(J, -1.5)
    parts["D"] = np.abs(parts["G"]).T
    parts["G"] = np.abs(parts["G"])
    parts["laws"] = 0.1 * np.abs(parts["laws"])
    model.theta.data[: layout.size] = torch.from_numpy(layout.join(parts))
    model.scales.copy_(torch.from_numpy(rng.uniform(0.5, 2.0, len(model.scales))))
    model.scales[-1] = 0.05
    return model


PAIRS = [["u1", "u1_dot"], ["u1", "u2"]]
MODELS: dict[str, Callable[[int], Estimator]] = {
    "linear": linear,
    "linear_base": linear_base,
    "linear_motion": linear_motion,
    "gru": lambda n: recurrent(n, 2, states=False),
    "gru_of_three_layers": lambda n: recurrent(n, 3, inputs=7),
    "vwnn": lambda n: vwnn(n, n),
    "vwnn_third_order": lambda n: vwnn(n, 1, order=3 if n < 10 else [1, 2], stages=1, bias=False),
    "vwnn_no_squares": lambda n: vwnn(n, 1, order=[2], squares=False, stages=3),
    "vwnn_forward": lambda n: vwnn_forward(n, 1, cutoffs=(0.3, 2.0, 20.0), factors=2, order=(1, 2)),
    "global_mlp": lambda n: mlp(n, GlobalMLP, 1, hidden=(7,), activation="silu"),
    "residual_mlp": lambda n: mlp(n, ResidualMLP, 2, hidden=(4, 6, 5), activation="relu"),
    "power_series_residual": lambda n: polynomial(n, fits="residual", order=3),
    "power_series_pairs": lambda n: polynomial(n, order=2, pairs=PAIRS if n > 1 else PAIRS[:1]),
    "chebyshev_restoring_force": lambda n: polynomial(n, order=3, basis="chebyshev"),
    "neural_state_space": lambda n: neural_state_space(n, 1),
    "modal_network": lambda n: modal(n, 2, 2),
    "linear_modes": lambda n: modal(n, 1, 0, substeps=1),
}


def identified(model: Estimator, record: Record) -> Estimator:
    model.identify([record])
    return model


ELEMENTS: dict[str, Callable[[], Estimator]] = {
    "sliders": lambda: identified(PrandtlIshlinskii(1, 2, DT, sliders=2, nodes=5), element_test()),
    "surface": lambda: identified(RestoringForceSurface(1, 2, DT, order=4), element_test()),
    "linear_motion": lambda: identified(LinearMotion(1, 2, DT), element_test()),
}
