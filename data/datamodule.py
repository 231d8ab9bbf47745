"""Simulated measurements as a LightningDataModule: training and test records, cut into windows."""

from __future__ import annotations

from typing import Any

from lightning.pytorch import LightningDataModule
from torch.utils.data import DataLoader

from data.excitation import Excitation
from data.generate import Escape, Simulation
from data.record import Record, stack
from data.scenario import Scenario
from data.structure import Structure
from data.windows import WindowDataset


class SimulatedData(LightningDataModule):
    """Training and test motions of one structure, each `duration` [s] long, sampled every `dt` [s].

    `window`, `stride` and `warmup` are in samples. Models are fitted to windows, whole records by
    default, and scored on whole records less their warm-up. `batch` windows are handed out at a
    time, shuffled; all at once by default. `validation` is
    the last fraction of each training record, held back from the fit. `tolerance` is the
    integrator's (data/simulate.py).
    """

    def __init__(
        self,
        structure: Structure,
        excitation: Excitation,
        scenario: Scenario,
        seed: int,
        name: str = "structure",
        dt: float = 0.01,
        duration: float = 50.0,
        train_records: int = 1,
        test_records: int = 1,
        tolerance: float = 1e-7,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: int | None = None,
        validation: float = 0.0,
    ) -> None:
        super().__init__()
        if not 0.0 <= validation < 1.0:
            raise ValueError(f"data.validation={validation} must be a fraction in [0, 1)")
        self.simulation = Simulation(structure, excitation, scenario, dt, duration, name, tolerance)
        self.seed, self.train_records, self.test_records = seed, train_records, test_records
        self.cut: dict[str, Any] = {"length": window, "stride": stride, "warmup": warmup}
        self.batch, self.validation = batch, validation
        self.escapes: list[Escape] = []
        self.records: dict[str, list[Record]] = {}

    @property
    def dofs(self) -> int:
        return self.simulation.structure.dofs

    @property
    def inputs(self) -> int:
        """Channels of excitation that an estimator may read."""
        moving = 2 * self.simulation.structure.supports if self.simulation.excitation.support else 0
        return len(self.simulation.excitation.driven(self.simulation.structure)) + moving

    def setup(self, stage: str | None = None) -> None:
        if self.records:
            return
        counts = {"train": self.train_records, "test": self.test_records}
        for split, first in (("train", 0), ("test", self.train_records)):
            records, escapes = self.simulation.records(split, counts[split], self.seed, first)
            self.records[split] = records
            self.escapes += escapes
        if self.validation > 0.0:
            whole = self.records["train"]
            first = round((1.0 - self.validation) * whole[0].samples)
            self.records["train"] = [r.window(0, first) for r in whole]
            self.records["validation"] = [r.window(first, r.samples - first) for r in whole]

    def windows(self, split: str) -> WindowDataset:
        return WindowDataset(self.records[split], **self.cut)

    def loader(self, split: str) -> DataLoader[Any]:
        """Whole records, to score and to solve closed forms on."""
        whole = WindowDataset(self.records[split], warmup=self.cut["warmup"])
        return DataLoader(
            whole, batch_size=len(whole) if self.batch is None else 1, collate_fn=stack
        )

    def train_dataloader(self) -> DataLoader[Any]:
        """Windows of the training motions."""
        windows = self.windows("train")
        batch, shuffle = self.batch or len(windows), self.batch is not None
        return DataLoader(windows, batch_size=batch, shuffle=shuffle, collate_fn=stack)

    def val_dataloader(self) -> DataLoader[Any] | list[Any]:
        """The part held back for validation, or nothing."""
        return self.loader("validation") if self.validation > 0.0 else []

    def test_dataloader(self) -> list[DataLoader[Any]]:
        """Training and test motions, in this order: both are scored."""
        return [self.loader("train"), self.loader("test")]
