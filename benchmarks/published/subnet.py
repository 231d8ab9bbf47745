"""SUBNET: a neural state space, started anywhere in a record by an encoder of the samples before.

deepSI 0.4 (BSD), Beintema, Schoukens & Tóth (2023), doi 10.1016/j.automatica.2023.111210.
x[k+1] = f(x[k], u[k]), a[k] = h(x[k], u[k]); networks f, h and encoder, Adam, and the error over
sections simulated from encoded states are the package's own; training ends with its processor time.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from os import devnull
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from data.record import Drive, Record

STATES = 12  # displacements, velocities, and a force with memory for each of six elements
PAST = 20  # samples that the encoder reads: the package's default
SECTION = 50  # samples simulated from an encoded state: the package's default
BATCH = 64  # sections, as in the package's overview: more iterations in the time than with 256
CHECK = 100  # iterations between validations
HELD_BACK = 0.2  # of every record, its end; the network that simulates it best is kept
UNLIMITED = 10**9  # iterations
PACKAGE = "deepSI"


def at_rest(signal: np.ndarray) -> np.ndarray:
    """A signal (T, c) after as many samples at rest as the encoder reads."""
    return np.concatenate([np.zeros((PAST, signal.shape[1])), signal])


def fit(records: list[Record], seed: int, seconds: float) -> Callable[[Drive], np.ndarray]:
    """Training ends after `seconds` of processor."""
    dsi = import_module("deepSI")
    dt = records[0].dt
    whole = [
        dsi.Input_output_data(at_rest(r.f.numpy()), at_rest(r.a.numpy()), sampling_time=dt)
        for r in records
    ]
    first = round((1.0 - HELD_BACK) * records[0].samples)
    train, validation = [w[:first] for w in whole], [w[first:] for w in whole]
    torch.manual_seed(seed)
    shape = {"nx": STATES, "na": PAST, "nb": PAST, "feedthrough": True}  # a force is felt at once
    model = dsi.SUBNET(*dsi.get_nu_ny_and_auto_norm(train), **shape)
    trained(dsi, model, train, validation, seconds)

    @torch.no_grad()
    def simulate(drive: Drive) -> np.ndarray:
        """Acceleration (T, n) from rest."""
        u = at_rest(drive.u.numpy())
        y = np.zeros((len(u), model.ny))
        return model.simulate(dsi.Input_output_data(u, y, sampling_time=dt)).y[PAST:]

    return simulate


def trained(dsi: Any, model: Any, train: list, validation: list, seconds: float) -> None:
    """The package's `fit`, ended as its user would, by an interrupt, when the time is over."""
    end = time.process_time() + seconds

    def loss(*arguments: Any) -> Tensor:
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
        settings = {"T": SECTION, "batch_size": BATCH, "val_freq": CHECK, "loss_fun": loss}
        dsi.fit(model, train, validation, n_its=UNLIMITED, **settings)
