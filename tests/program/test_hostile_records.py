"""Records, weights and forces of strangers: taken in double precision or refused in one line."""

from __future__ import annotations

import os
import pickle
import sys
import types
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
import torch
from safetensors.torch import load_file, save_file

import data
import models
from data import numba_cache
from data.record import Record
from models.checkpoint import load_estimator, save_estimator
from runner.launch import processes, ray_cluster
from runner.launch.ray_cluster import RayLauncher
from tests.hostile_files import Bomb

# records, batches and weights


def record(**signals) -> Record:
    generator = torch.Generator().manual_seed(0)
    u = {k: torch.randn(60, 2, generator=generator, dtype=torch.float64) for k in "afxv"}
    return Record(0.01, **{**u, **signals})


@pytest.mark.parametrize(
    "spoil",
    [
        lambda u: u > 0.0, lambda u: u.cfloat(), lambda u: u.numpy(), lambda u: u.to("meta"),
        lambda u: u.to_sparse(), lambda u: u[:, :0], lambda u: u[:0], lambda u: u[:1],
        lambda u: u[None][:0], lambda u: None,
    ],
)  # fmt: skip
def test_a_record_of_no_signals_is_refused(spoil):
    with pytest.raises(ValueError, match=r"^a |^a record"):
        record(a=spoil(torch.zeros(60, 2, dtype=torch.float64)))


@pytest.mark.parametrize("dtype", [torch.float32, torch.int64])
def test_a_record_of_other_precision_is_fitted_in_double(dtype):
    taken, u = record(a=record().a.to(dtype)), record().a.to(dtype).to(torch.float64)
    assert taken.a.dtype == torch.float64
    assert torch.equal(taken.a, u)
    models.VWNN(2, 2, 0.01, ridge=1e-6).identify([taken])


def test_what_an_estimator_is_handed_is_looked_at_in_one_place():
    model, good = models.VWNN(2, 2, 0.01, ridge=1e-6), record()
    for batches, words in (
        ([], "no records"),
        (good, r"identify\(\[record\]\)"),
        ([3], "int is no"),
    ):
        with pytest.raises(ValueError, match=words):
            model.identify(batches)
    model.identify([good])
    lost = good.a.clone()
    lost[7, 1] = torch.nan
    with pytest.raises(ValueError, match="a is not finite at sample 7"):
        model(record(a=lost))
    with pytest.raises(ValueError, match="Record is no Drive"):
        model.free_run(good)
    with pytest.raises(ValueError, match="u of the free run is not finite"):
        model.free_run(replace(good.drive(), u=torch.full_like(good.f, torch.inf)))


def test_weights_of_another_time_step_or_other_settings_are_refused(tmp_path):
    path, model = tmp_path / "model.safetensors", models.VWNN(2, 2, 0.01, ridge=1e-6)
    model.identify([record()])
    save_estimator(model, path, "vwnn")
    load_estimator(models.VWNN(2, 2, 0.01, ridge=1e-6), path, "vwnn")
    for other, words in (
        (models.VWNN(2, 2, 0.02, ridge=1e-6), r"stored with dt=0\.01; this model has dt=0\.02"),
        (models.VWNN(2, 2, 0.01, 40.0, ridge=1e-6), r"cutoff=50\.0; this model has cutoff=40\.0"),
    ):
        with pytest.raises(ValueError, match=words):
            load_estimator(other, path, "vwnn")
    tensors = load_file(path)
    save_file(tensors, path, metadata={"model": "vwnn"})  # of older code
    load_estimator(models.VWNN(2, 2, 0.01, ridge=1e-6), path, "vwnn")
    incomplete = {key: u for key, u in tensors.items() if key != "filters.decay"}
    reshaped = {**tensors, "weights": tensors["weights"][:-1].contiguous()}
    for spoil, words in (
        (
            lambda: save_file(tensors, path, metadata={"model": "linear"}),
            "holds the model 'linear'",
        ),
        (lambda: save_file(incomplete, path, metadata={"model": "vwnn"}), r"does not fit.*decay"),
        (lambda: save_file(reshaped, path, metadata={"model": "vwnn"}), r"does not fit.*weights"),
        (lambda: path.write_bytes(path.read_bytes()[:-100]), "cannot be read"),
        (lambda: path.write_bytes(pickle.dumps(Bomb())), "cannot be read"),
    ):
        spoil()
        with pytest.raises(ValueError, match=words):
            load_estimator(models.VWNN(2, 2, 0.01, ridge=1e-6), path, "vwnn")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.npy", b""),
        ("cut.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'sh"),
        ("huge.npy", b"\x93NUMPY\x01\x00v\x00"
         + b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 3), }".ljust(117)
         + b"\n"),
        ("words.npy", b"one,two"),
        ("words.csv", b"one,two\nthree,four\n"),
        ("ragged.csv", b"1,2\n3\n"),
        ("latin.csv", b"\xff\xfe1,2\n"),
    ],
)  # fmt: skip
def test_a_damaged_table_of_forces_is_named(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=name.replace(".", r"\.")) as error:
        data.Given(path=str(tmp_path / name))
    assert len(str(error.value).splitlines()) == 1


# What others left behind or keep open: the cache of compiled code, Ray, orphans


# numba unpickles what lies in its cache


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A compiled file, and the user's caches, in folders of the user's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    source = tmp_path / "project" / "law.py"
    (source.parent / "__pycache__").mkdir(parents=True)
    source.write_text("def force(y):\n    return 2.0 * y\n")
    return source


def place(source: Path) -> str | None:
    """Where the cache is: beside the code, among the user's caches, or nowhere."""
    folder = numba_cache._cache_folder([source])
    return None if folder is None else Path(folder).parent.parent.name


def test_the_cache_lies_beside_the_code_and_nobody_else_can_write_it(project):
    folder = Path(numba_cache._cache_folder([project]))
    assert folder.parent == project.parent / "__pycache__"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert numba_cache._cache_folder([project]) == str(folder)


@pytest.mark.parametrize("mode", [0o775, 0o757])
def test_a_cache_that_others_can_write_is_not_used(project, mode):
    planted = Path(numba_cache._cache_folder([project]))
    planted.chmod(mode)
    assert place(project) == "caches"
    (project.parent / "__pycache__").chmod(mode)
    planted.chmod(0o700)
    assert place(project) == "caches"


def test_a_cache_of_another_user_or_behind_a_link_is_not_used(project, monkeypatch):
    own = Path(numba_cache._cache_folder([project]))
    own.rename(own.with_name("elsewhere"))
    own.symlink_to(own.with_name("elsewhere"))
    assert place(project) == "caches"
    own.unlink()
    monkeypatch.setattr(os, "getuid", lambda: 12345)  # all folders are somebody else's
    assert place(project) is None


def test_a_project_that_cannot_be_written_is_cached_by_its_user_or_not_at_all(
    project, monkeypatch, tmp_path
):
    (project.parent / "__pycache__").rmdir()
    (project.parent / "__pycache__").write_text("")  # root may write whatever the mode says
    assert place(project) == "caches"
    assert (tmp_path / "caches" / "structural-model-zoo").stat().st_mode & 0o777 == 0o700
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    assert place(project) is None
    compiled, _ = numba_cache.compilers(project)
    assert compiled(lambda y: 2.0 * y)(4.0) == 8.0


# Ray, and processes that lost their parent


def test_ray_on_this_machine_listens_to_it_alone(monkeypatch):
    given: dict[str, object] = {}
    fake = types.SimpleNamespace(
        init=lambda **arguments: given.update(arguments),
        remote=lambda function: types.SimpleNamespace(
            options=lambda **_: types.SimpleNamespace(remote=lambda words: None)
        ),
        get=lambda result: result,
        shutdown=lambda: None,
        exceptions=types.SimpleNamespace(RayError=RuntimeError),
    )
    monkeypatch.setitem(sys.modules, "ray", fake)
    worker = types.SimpleNamespace(environment={})
    assert RayLauncher().work(worker, [["seed=0"]]) == {}
    assert given["_node_ip_address"] == ray_cluster.LOOPBACK
    assert ray_cluster.LOOPBACK.startswith("127.")
    assert given["include_dashboard"] is False
    given.clear()
    RayLauncher(address="auto").work(worker, [["seed=0"]])
    assert "_node_ip_address" not in given


def test_a_worker_ends_when_its_parent_has_whatever_the_platform_says(monkeypatch):
    class EndedError(Exception):
        pass

    def end(status):
        raise EndedError

    states = iter([psutil.STATUS_RUNNING, psutil.STATUS_RUNNING, psutil.STATUS_ZOMBIE])
    parent = types.SimpleNamespace(is_running=lambda: True, status=lambda: next(states))
    monkeypatch.setattr(processes.psutil, "Process", lambda pid: parent)
    monkeypatch.setattr(processes.time, "sleep", lambda seconds: None)
    monkeypatch.setattr(processes.os, "_exit", end)
    monkeypatch.delattr(processes.os, "getppid")
    with pytest.raises(EndedError):
        processes._end_with(1)
    assert not list(states)
