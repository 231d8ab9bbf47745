"""hydra/launcher=ray: the runs of a sweep as tasks of a Ray cluster, of this machine or of many.

Ray keeps a process from run to run, and gives the runs of a lost process to others. Ray is an
extra, imported where it is used. Not through hydra-ray-launcher: it asks for boto3 and for
cloudpickle<3, against constraints.txt, and its first lost run ends the sweep.
"""

from __future__ import annotations

import os
import socket
import sys

from runner.launch.launcher import SweepLauncher, Worker

# Ray listens at its node's address. It takes 127.0.0.1 for a mistake and puts the machine's address
# on the network in its place; of Linux's loopback every other address of 127.0.0.0/8 will do. Other
# systems have but one, where Ray begins by itself.
LOOPBACK = "127.0.0.2" if sys.platform == "linux" else "127.0.0.1"
OF_THIS_MACHINE = {"include_dashboard": False, "_node_ip_address": LOOPBACK}


class RayLauncher(SweepLauncher):
    """`cpus`, `gpus` and `memory_gb` of a run; `retries` of a run whose process is lost."""

    def __init__(
        self,
        address: str = "local",
        cpus: float = 1,
        gpus: float = 0,
        memory_gb: float | None = None,
        retries: int = 3,
    ) -> None:
        self.address, self.retries = address, retries
        memory = None if memory_gb is None else int(memory_gb * 2**30)
        self.needs = {"num_cpus": cpus, "num_gpus": gpus, "memory": memory}

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # else Ray reports to its makers
        try:
            import ray
        except ModuleNotFoundError:
            raise ValueError(
                "hydra/launcher=ray needs Ray; pip install -c constraints.txt -e '.[ray]'"
            ) from None
        self._check_address()
        try:
            ray.init(
                address=self.address,
                runtime_env={"env_vars": worker.environment},
                **(OF_THIS_MACHINE if self.address == "local" else {}),
                log_to_driver=False,
                logging_level="ERROR",
            )
        except (ConnectionError, ray.exceptions.RayError) as error:
            reason = " ".join(str(error).split())
            raise ValueError(f"hydra.launcher.address={self.address}: {reason}") from None
        try:
            # a process unpickles the function, and with it the worker, once for all its runs
            run = ray.remote(lambda words: worker(words))
            run = run.options(max_retries=self.retries, **self.needs)
            return self._lost({" ".join(words): run.remote(words) for words in jobs})
        finally:
            ray.shutdown()

    def _check_address(self) -> None:
        """Raise ValueError where nobody listens; Ray itself would try for minutes."""
        host, _, port = self.address.partition(":")
        if not port.isdigit():
            return
        try:
            socket.create_connection((host, int(port)), timeout=10.0).close()
        except OSError as error:
            raise ValueError(
                f"hydra.launcher.address={self.address} does not answer ({error}); "
                f"ray start --head --port={port} starts a cluster there, see docs/sweeps.md"
            ) from None

    def _lost(self, results: dict) -> dict[str, str]:
        import ray

        lost = {}
        for name, result in results.items():
            try:
                reason = ray.get(result)
            except ray.exceptions.RayError as error:
                reason = " ".join(str(error).split())
            if reason:
                lost[name] = reason
        return lost
