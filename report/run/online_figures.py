"""Pictures of an on-line model on one record: running error and weights over time."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from data.record import QUANTITIES, Record
from models.estimator import Estimator
from models.online.adaptive import Online, single
from models.online.stream import started
from report.run.figures import draw_running_errors
from report.style import DASHES, SERIES, TRUE, titled

COLOURS = {"from nothing": "#d1495b", "adapting": "#2e6f95", "frozen": "#222222"}
NAMED = 3  # weights of each DOF in colour, those with the largest share at the end
STRETCHES = 250  # points of a curve of weights


def online_figures(estimator: Estimator, batch: Record, on: str = "") -> dict[str, Figure]:
    """Figures of an on-line model by name, on the first record of a batch; {} for other models.

    on: the model's and the record's name.
    """
    if not isinstance(estimator, Online):
        return {}
    record = next(single(batch.measured()))
    return {
        "running_error": titled(running_errors(estimator, record), f"{on}, one step ahead"),
        "weights_over_time": titled(weights_over_time(estimator, record), f"{on}, from nothing"),
    }


def running_errors(model: Online, record: Record) -> Figure:
    """Draw the error of the last seconds against time, a line for each way of estimating."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    with torch.no_grad():
        found = model.estimates(record).items()
    estimates = {way.replace("_", " ") or "adapting": estimate for way, estimate in found}
    draw_running_errors(axes, record, estimates, COLOURS)
    axes.legend(frameon=False)
    return figure


def weights_over_time(model: Online, record: Record) -> Figure:
    """Draw every weight, from zero on, times its feature's RMS; a row for each DOF.

    The product is the weight's share in the estimated acceleration, and has its unit. Those with
    the largest share at the end are named by the places of their features.
    """
    heads, sizes = model.estimator.heads(), feature_sizes(model, record)
    outputs = [(j, i) for j, head in enumerate(heads) for i in range(head.shape[1])]
    states = started(model.estimator, model.law, from_nothing=True)
    longest = -(-record.samples // STRETCHES)
    history = [
        [state.weights for state in states]
        for _, states in model.stretches(record, model.law, states, longest)
    ]
    t = record.dt * np.linspace(longest, record.samples, len(history))
    figure = Figure(figsize=(9.0, 1.9 * len(outputs) + 0.8), layout="constrained")
    symbol, unit = QUANTITIES[record.quantity]
    what = f"{record.quantity} {symbol}"
    if len(heads) > 1:
        what, unit = "modal force h", "of its mode"
    for row, (j, i) in enumerate(outputs):
        axes = figure.add_subplot(len(outputs), 1, row + 1)
        curves = torch.stack([weights[j][:, i] for weights in history]) * sizes[j]  # (K, P)
        axes.plot(t, curves.cpu().numpy(), color=TRUE, linewidth=0.6)
        largest = curves[-1].abs().nan_to_num().argsort(descending=True)[:NAMED].tolist()
        for place, feature in enumerate(largest):
            curve, colour, dash = curves[:, feature].cpu().numpy(), SERIES[3 * place], DASHES[place]
            axes.plot(t, curve, color=colour, linestyle=dash, label=f"feature {feature + 1}")
        late = curves[len(curves) // 5 :]
        reach = 1.3 * float(late[torch.isfinite(late)].abs().max()) if late.numel() else 0.0
        axes.set_ylim(-(reach or 1.0), reach or 1.0)
        axes.set_ylabel(f"share in the\n{what}{row + 1} [{unit}]", fontsize="small")
        axes.margins(x=0.0)
        axes.tick_params(labelbottom=row == len(outputs) - 1)
        axes.grid(alpha=0.25)
        axes.legend(frameon=False, fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_xlabel("time [s]; grey: all other weights, each times the RMS of its feature")
    return figure


def feature_sizes(model: Online, record: Record) -> list[Tensor]:
    """RMS (P_j,) of the features of each head over a record."""
    squares: list[Tensor] = []
    for _, phi in model.estimator.features_of(record):
        sums = [u.square().sum(dim=0) for u in phi]
        squares = [a + b for a, b in zip(squares, sums, strict=True)] if squares else sums
    return [torch.sqrt(u / record.samples) for u in squares]
