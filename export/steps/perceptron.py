"""A multilayer perceptron as a function of one sample: models/layers/perceptron.py.

Weights stand layer by layer in one list, transposed, so that loops over neurons are contiguous.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from torch import nn

from models.layers.perceptron import ACTIVATIONS, Perceptron


def _activated(x, activation):
    if activation == 0:
        return math.tanh(x)
    if activation == 1:
        return 0.5 + 0.5 * math.tanh(0.5 * x)
    if activation == 2:
        return max(x, 0.0)
    return x * (0.5 + 0.5 * math.tanh(0.5 * x))


def network(signal, found, weights, biases, sizes, inner, outer, widest, activation):
    """Fills `found` (outputs,) from a signal (inputs,), both in physical units.

    sizes (layers + 1,): neurons; inner (2, inputs), outer (2, outputs): centre and reach.
    """
    below = np.zeros(widest)
    above = np.zeros(widest)
    for j in range(signal.size):
        below[j] = (signal[j] - inner[0, j]) / inner[1, j]
    weight, bias = 0, 0
    for layer in range(sizes.size - 1):
        rows = sizes[layer + 1]
        for i in range(rows):
            above[i] = biases[bias + i]
        bias += rows
        for j in range(sizes[layer]):
            for i in range(rows):
                above[i] += weights[weight + i] * below[j]
            weight += rows
        if layer < sizes.size - 2:
            for i in range(rows):
                below[i] = _activated(above[i], activation)
    for i in range(found.size):
        found[i] = outer[0, i] + outer[1, i] * above[i]


def numbers_of(model: Perceptron) -> dict[str, Any]:
    """What `network` is given beside its signal."""
    layers = [layer for layer in model.layers if isinstance(layer, nn.Linear)]
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    kinds = {type(layer) for layer in model.layers} - {nn.Linear}
    scales = model.input_scale, model.output_scale
    inner, outer = (np.stack([s.centre.numpy(), s.reach.numpy()]) for s in scales)
    return {
        "weights": np.concatenate([layer.weight.detach().numpy().T.ravel() for layer in layers]),
        "biases": np.concatenate([layer.bias.detach().numpy() for layer in layers]),
        "sizes": np.array(sizes),
        "inner": inner,
        "outer": outer,
        "widest": max(sizes),
        "activation": list(ACTIVATIONS.values()).index(kinds.pop()),
    }
