"""Who does the runs of a sweep: one process, all cores of this machine, a Ray cluster, Slurm.

launcher.py     what the launchers share: one process for each run, the reasons of lost runs
processes.py    hydra/launcher=joblib: processes side by side on one machine, a lost one replaced
ray_cluster.py  hydra/launcher=ray
slurm.py        hydra/launcher=slurm
batched.py      hydra/launcher=batched: as joblib, a batch of runs at a time, without a Trainer
"""
