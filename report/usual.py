"""Folders of runs that the reports read where none is named."""

from __future__ import annotations

from pathlib import Path

STUDY, OUTSIDE, CLOSE_FIT = Path("runs/study"), Path("runs/outside"), Path("runs/close_fit")
LEADERBOARD, QUESTIONS = Path("runs/free_run"), Path("runs/free_run_questions")
BENCHMARKED, STAND_INS = Path("runs/benchmarks"), Path("runs/stand_ins")
ONLINE, STABILITY = Path("runs/online"), Path("runs/online_stability")
SEARCHES = tuple(Path(f"runs/tune_{what}") for what in ("vwnn", "polynomial", "networks"))
