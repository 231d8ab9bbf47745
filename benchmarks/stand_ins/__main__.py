"""Write a stand-in's files:  python -m benchmarks.stand_ins silverbox FOLDER [--seed 1]

Then  python train.py data=benchmark data.name=silverbox data.folder=FOLDER model=modal_network
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.stand_ins.files import STAND_INS


def main() -> None:
    """Write the files, and print the noise in their outputs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("benchmark", choices=sorted(STAND_INS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    noise = STAND_INS[words.benchmark](words.folder, seed=words.seed)
    print(f"RMS of the noise, by output: {', '.join(f'{value:.4g}' for value in noise)}")


if __name__ == "__main__":
    main()
