"""What others left behind or keep open: the cache of compiled code, Ray, orphans."""

from __future__ import annotations

import os
import sys
import types
from pathlib import Path

import psutil
import pytest

from data import numba_cache
from runner.launch import processes, ray_cluster
from runner.launch.ray_cluster import RayLauncher

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
