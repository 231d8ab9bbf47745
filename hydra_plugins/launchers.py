"""The launchers by the names that Hydra knows: it takes plugins from hydra_plugins alone.

Modules are imported and not their classes: Hydra would register an imported class a second time.
"""

from runner.launch import batched, processes, ray_cluster, slurm


class BatchedLauncher(batched.BatchedLauncher):
    """hydra/launcher=batched: runs that differ in their seed alone side by side in one process."""


class JoblibLauncher(processes.JoblibLauncher):
    """hydra/launcher=joblib: all cores of this machine, one process a core."""


class RayLauncher(ray_cluster.RayLauncher):
    """hydra/launcher=ray: tasks of a Ray cluster."""


class SlurmLauncher(slurm.SlurmLauncher):
    """hydra/launcher=slurm: a few Slurm jobs, each with its share of the runs."""
