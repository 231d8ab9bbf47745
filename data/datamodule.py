"""Training and test records as a LightningDataModule, cut into windows.

Subclasses say where records come from: data/simulation/datamodule.py simulates a structure,
data/measured/datamodule.py reads files, data/public/datamodule.py takes public benchmarks.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatch
from typing import Any

from lightning.pytorch import LightningDataModule
from torch.utils.data import DataLoader

from data.annotations import Count, Fraction
from data.memory import require_memory
from data.record import Escape, Record, stack
from data.sample import Sensors
from data.windows import WindowDataset, after_rest, cut

EACH = "each record"  # under which `notes` has what holds for every record of a split


def matching(names: Sequence[str], wanted: str | Sequence[str] | None, key: str) -> list[str]:
    """Names of records that are wanted, by name or by patterns as in a shell; none for None.

    Raises ValueError, naming data.`key`, for a pattern that matches none.
    """
    patterns = [] if wanted is None else [wanted] if isinstance(wanted, str) else list(wanted)
    for pattern in patterns:
        if not any(name == pattern or fnmatch(name, pattern) for name in names):
            raise ValueError(f"data.{key}: no record is called {pattern}; {', '.join(names)} are")
    return [name for name in names if any(name == p or fnmatch(name, p) for p in patterns)]


def _after(record: Record, share: float) -> int:
    """The sample before which so much of the motion's power lies: the end of many is a rest."""
    power = record.a.square().sum(dim=-1).cumsum(dim=0)
    return int((power < share * power[-1]).sum())


class Data(LightningDataModule):
    """Training and test records of one structure: the base class of all sources of records.

    `window`, `stride` and `warmup` are in samples. Models are fitted to windows, whole records by
    default, and scored on whole records less their warm-up. `batch` windows are handed out at a
    time, shuffled; all at once by default. `validation` is the last fraction of each training
    motion, by its power, held back from the fit; it is run from the record's beginning, for laws
    remember.
    """

    name: str
    dt: float  # [s]
    dofs: int
    inputs: int  # channels of excitation that an estimator may read
    forced: list[int] | str | None = None  # DOFs that carry the forces; "base": all, by M ι s̈
    quantity: str = "acceleration"  # what is estimated, see data.record.QUANTITIES
    elements: tuple[str, ...] = ()  # names, where the elements are known
    topology: str | None = None  # of unknown elements, as in `Sensors`
    measured: bool = False  # by sensors of somebody's own: priors are chosen on held-back motion

    def __init__(
        self,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: Count | None = None,
        validation: Fraction = 0.0,
    ) -> None:
        super().__init__()
        self.cut: dict[str, Any] = {"length": window, "stride": stride, "warmup": warmup}
        self.batch, self.validation = batch, validation
        self.escapes: list[Escape] = []  # motions that were left out
        self.notes: dict[str, list[str]] = {}  # by record, what was noticed and done
        self.names: dict[str, list[str]] = {}  # of the records of each split, where they have some
        self.records: dict[str, list[Record]] = {}
        self.settled: dict[str, Any] = {}  # settings that the training records decided
        self.units: dict[str, str] = {}  # of the records' values, by channel, where known

    @property
    def sensors(self) -> Sensors:
        """All that a model must know of the records to be built for them."""
        known = (self.forced, self.quantity, tuple(self.units), self.units)
        return Sensors(self.dt, self.dofs, self.inputs, *known, self.topology)

    @property
    def numbers(self) -> list[int]:
        """Numbers of the DOFs that are estimated."""
        return self.sensors.numbers

    @abstractmethod
    def make_records(self) -> dict[str, list[Record]]:
        """Records of the splits "train" and "test", and "calibration" where some were named."""

    def make_calibration(self) -> list[Record]:
        """Whole records that nothing else sees, for bands; [] where there are none.

        Made when they are first asked for. Raises ValueError, with the remedy, where they cannot
        be.
        """
        return []

    def calibration_loader(self) -> DataLoader[Any] | None:
        """Whole records that were neither trained on, nor chosen by, nor tested; None: no such."""
        if "calibration" not in self.records:
            self.records["calibration"] = self.make_calibration()
        return self.loader("calibration") if self.records["calibration"] else None

    def own_error(self) -> float | None:
        """Relative error of the records themselves, where it is known."""
        return None

    def setup(self, stage: str | None = None) -> None:
        """Make the records, and hold the validation part back; a second call does nothing."""
        if self.records:
            return
        records = self.make_records()
        if self.validation > 0.0:
            whole = records["train"]
            first = [_after(r, 1.0 - self.validation) for r in whole]
            pairs = list(zip(whole, first, strict=True))
            for record, k in pairs:
                if not record.a.any():
                    raise ValueError("a record to train on is zero throughout; check its sensors")
                if k < 2 or record.samples - k < 2:
                    raise ValueError(
                        f"data.validation={self.validation} leaves {k} of {record.samples} samples "
                        f"to train on and {record.samples - k} to validate; expected 2 or more of "
                        "each; change it or take longer records"
                    )
            records["train"] = [r.window(0, k, r.warmup) for r, k in pairs]
            records["validation"] = [replace(r, warmup=k) for r, k in pairs]
        train = records["train"]
        signals = train[0].signals().values()
        self.check_windows([r.samples for r in train], sum(u.shape[-1] for u in signals))
        self.records = records

    def check_windows(self, samples: Sequence[int], channels: int) -> None:
        """Raise ValueError for windows that do not fit training records, or not in memory.

        samples: of each record; channels: of one, with those that only a simulation knows.
        """
        length, stride = cut(min(samples), **self.cut)
        count = sum((T - length) // stride + 1 for T in samples)
        together = count if self.batch is None else min(count, self.batch)
        require_memory(
            16.0 * channels * length * together,
            f"{together} windows of data.window={length} samples at once, one every {stride},",
            "raise data.stride, or set data.batch",
        )

    def windows(self, split: str) -> WindowDataset:
        """Windows of the records of a split, as `window`, `stride` and `warmup` cut them.

        Whole records of unequal length that begin at rest are given rest before them, which adds
        nothing to any error, so that one batch holds them all.
        """
        records, cut = self.records[split], dict(self.cut)
        if self.cut["length"] is None and len({r.samples for r in records}) > 1:
            if all(r.initial_state == "rest" and r.truth is None for r in records):
                longest = max(r.samples for r in records)
                records = [after_rest(r, longest) for r in records]
            else:
                cut["to_the_end"] = True
        return WindowDataset(records, **cut)

    def loader(self, split: str) -> DataLoader[Any]:
        """Whole records of a split, for scores and closed forms; one batch if equally long."""
        records = self.records[split]
        whole = WindowDataset(records, warmup=self.cut["warmup"], whole=True)
        together = self.batch is None and len({(r.samples, r.warmup) for r in records}) == 1
        return DataLoader(whole, batch_size=len(whole) if together else 1, collate_fn=stack)

    def train_dataloader(self) -> DataLoader[Any]:
        """Windows of the training motions."""
        windows = self.windows("train")
        batch, shuffle = self.batch or len(windows), self.batch is not None
        return DataLoader(windows, batch_size=batch, shuffle=shuffle, collate_fn=stack)

    def val_dataloader(self) -> DataLoader[Any] | list[Any]:
        """The parts held back alone, or an empty list where no run can begin in them."""
        held_back = self.records.get("validation", [])
        parts = [r.window(r.warmup, r.samples - r.warmup) for r in held_back]
        if not parts or any(part.x is None or part.v is None for part in parts):
            return []
        return DataLoader(WindowDataset(parts, whole=True), batch_size=1, collate_fn=stack)

    def test_dataloader(self) -> list[DataLoader[Any]]:
        """Training and test records, in this order, then those held back: all are scored."""
        held_back = ["validation"] if self.validation > 0.0 else []
        return [self.loader(split) for split in ("train", "test", *held_back)]
