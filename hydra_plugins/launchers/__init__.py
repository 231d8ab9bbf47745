"""Who does the runs of a sweep: all cores of this machine, a Ray cluster, Slurm.

launcher.py     what they share: a run in a process of its own, what is told of lost runs
processes.py    processes side by side on one machine; a lost one is replaced
all_cores.py    hydra/launcher=joblib
ray_cluster.py  hydra/launcher=ray
slurm.py        hydra/launcher=slurm
"""
