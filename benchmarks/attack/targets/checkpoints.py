"""Half-done training and identified models whose files were damaged, swapped or forged.

A resumed training must end as an undisturbed one, to the last bit; a damaged model must be refused.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import random
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import torch
from lightning.pytorch import Callback, Trainer
from safetensors.torch import load_file, save_file

import train
from benchmarks.attack.attempt import EXECUTED, Attempt, WronglyAcceptedError
from models.training import resume
from models.training.resume import seal
from runner.config.command_line import one_line_errors
from runner.folder.lock import release_all
from runner.folder.run import restore
from runner.folder.run_files import CHECKPOINT, PROGRESS
from runner.folder.run_folder import read_run

WORDS = (
    *("model=residual_mlp", "data.duration=2", "figures=false", "baselines=none"),
    *("solver=levenberg_marquardt", "solver.iterations=4", "checkpoint_seconds=0"),
    "trainer.enable_progress_bar=false",
)
KINDS = ("flip", "flip", "flip", "cut", "zero", "nan", "swap", "pickle", "sealed", "own", "kind")


class Hostile:
    def __reduce__(self) -> tuple:
        return os.system, (f"touch {EXECUTED}",)


class BrokenOffError(Exception):
    pass


class BreakOff(Callback):
    def on_train_epoch_start(self, trainer: Trainer, pl_module: object) -> None:
        if trainer.current_epoch == 2:
            raise BrokenOffError


class Target:
    name = "checkpoints"

    def prepare(self, folder: Path) -> None:
        """A run that ended, the same one broken off, and another one broken off."""
        _run(folder / "whole")
        for name, words in (("broken", ()), ("other", ("seed=1",))):
            begin = resume.SaveProgress.on_train_epoch_start
            resume.SaveProgress.on_train_epoch_start = BreakOff.on_train_epoch_start  # type: ignore[method-assign, assignment]
            with contextlib.suppress(BrokenOffError):
                _run(folder / name, *words)
            resume.SaveProgress.on_train_epoch_start = begin  # type: ignore[method-assign]
            release_all()
            if not (folder / name / PROGRESS).is_file():
                raise RuntimeError("no half-done training was saved")

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        kind, where, bit = draw.choice(KINDS), draw.random(), draw.randrange(8)
        if draw.random() < 0.1:
            return Attempt(f"resume {kind} {where:.4f} {bit}", _resumed(folder, kind, where, bit))
        part = draw.choice((CHECKPOINT, PROGRESS))
        check = _loaded if part == CHECKPOINT else _judged
        return Attempt(f"{part} {kind} {where:.4f} {bit}", check(folder, kind, where, bit))


def _run(folder: Path, *words: str) -> None:
    sys.argv = ["train.py", *WORDS, *words, f"hydra.run.dir={folder}"]
    with contextlib.redirect_stdout(io.StringIO()):
        train.cli()


def change(path: Path, kind: str, where: float, bit: int, other: Path) -> None:
    """Damage a file; `other` is of another run."""
    content = bytearray(path.read_bytes())
    place = int(where * len(content))
    if kind in ("flip", "zero"):
        content[place] = content[place] ^ 1 << bit if kind == "flip" else content[place] & 1
        path.write_bytes(content)
    elif kind == "cut":
        path.write_bytes(content[:place])
    elif kind == "swap":
        shutil.copy(other, path)
    elif kind == "kind":
        path.unlink()
        [path.mkdir, lambda: os.mkfifo(path), lambda: path.symlink_to("/dev/zero"), path.touch][
            bit % 4
        ]()
    elif kind == "pickle":
        payload = {"identity": {}, "state_dict": Hostile()}
        if bit % 2:
            path.write_bytes(pickle.dumps(payload))
        else:
            torch.save(payload, path)
        if bit > 3:
            seal(path)
    elif path.suffix == ".safetensors":
        tensors = load_file(path)
        name = sorted(tensors)[int(where * len(tensors))]
        tensors[name] = torch.full_like(tensors[name], float("nan") if kind == "nan" else 1.0)
        save_file(tensors, path, metadata={"model": "residual_mlp"})
    else:
        _change_checkpoint(path, kind, where, bit)


def _change_checkpoint(path: Path, kind: str, where: float, bit: int) -> None:
    checkpoint = torch.load(path, weights_only=True)
    if kind == "nan":
        state = checkpoint["state_dict"]
        name = sorted(state)[int(where * len(state))]
        state[name] = torch.full_like(state[name], float("nan"))
    elif kind == "own":
        checkpoint["identity"] = {"config": "other", "results": 0}
    torch.save(checkpoint, path)
    if kind != "sealed":  # which is whole, but of earlier code: without a digest
        seal(path)


def _loaded(folder: Path, kind: str, where: float, bit: int) -> Callable[[], None]:
    """A damaged model.safetensors is refused, unless it holds the same numbers."""

    def act() -> None:
        run = Path("run").absolute()
        shutil.copytree(folder / "whole", run)
        cfg, _ = read_run(run)
        expected = restore(cfg, run).state_dict()
        change(run / CHECKPOINT, kind, where, bit, folder / "other" / PROGRESS)
        same = (run / CHECKPOINT).is_file() and _content(run / CHECKPOINT) == _content(
            folder / "whole" / CHECKPOINT
        )
        with one_line_errors("evaluate"):
            found = restore(cfg, run).state_dict()
        if not same or any(not torch.equal(found[name], expected[name]) for name in expected):
            raise WronglyAcceptedError("a damaged model was taken")

    return act


def _content(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(2**24)


def _judged(folder: Path, kind: str, where: float, bit: int) -> Callable[[], None]:
    """Damaged training.ckpt is not gone on from, and no word of it is unpickled."""

    def act() -> None:
        run = Path("run").absolute()
        shutil.copytree(folder / "broken", run)
        identity = torch.load(run / PROGRESS, weights_only=True)["identity"]
        if resume.fault_of(run / PROGRESS, identity):
            raise WronglyAcceptedError("the whole file was refused")
        whole = _content(run / PROGRESS)
        change(run / PROGRESS, kind, where, bit, folder / "other" / PROGRESS)
        fault = resume.fault_of(run / PROGRESS, identity)
        if not fault and (kind == "kind" or _content(run / PROGRESS) != whole):
            raise WronglyAcceptedError("damaged training was taken")

    return act


def _resumed(folder: Path, kind: str, where: float, bit: int) -> Callable[[], None]:
    """Training from a damaged file ends with the numbers of an undisturbed one."""

    def act() -> None:
        run = Path("run").absolute()
        shutil.copytree(folder / "broken", run)
        change(run / PROGRESS, kind, where, bit, folder / "other" / PROGRESS)
        _run(run)
        ours, expected = (load_file(place / CHECKPOINT) for place in (run, folder / "whole"))
        if any(not torch.equal(ours[name], expected[name]) for name in expected):
            raise WronglyAcceptedError("resumed training ended with other numbers")

    return act
