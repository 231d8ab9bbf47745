"""Write a stand-in's files, or those of all:  python -m benchmarks.stand_ins silverbox FOLDER

noise.json beside them has the RMS of the noise by output.

Then  python train.py data=benchmark data.name=silverbox data.folder=FOLDER model=modal_network
"""

from __future__ import annotations

import json
from pathlib import Path

from report.benchmarks.rows import NOISE

from benchmarks.stand_ins.files import STAND_INS
from data.arguments import Parser
from runner.config.command_line import command_errors


def main() -> None:
    """Write the files, and print the noise in their outputs."""
    parser = Parser(description=__doc__)
    parser.add_argument("benchmark", choices=["all", *sorted(STAND_INS)])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    chosen = sorted(STAND_INS) if words.benchmark == "all" else [words.benchmark]
    place = words.folder / NOISE
    known = json.loads(place.read_text("utf-8")) if place.is_file() else {}
    for name in chosen:
        noise = STAND_INS[name](words.folder, seed=words.seed)
        known[name] = noise.tolist()
        print(f"{name}: RMS of the noise, by output: {', '.join(f'{v:.4g}' for v in noise)}")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(json.dumps(known), "utf-8")


if __name__ == "__main__":
    with command_errors():
        main()
