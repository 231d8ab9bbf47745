"""An on-line model of a shaking structure: measured against estimated, sample by sample.

python -m live simulation --run FOLDER                a finished run, its system simulated again
python -m live simulation system=bouc_wen             an untrained model
python -m live test --run FOLDER --speed 10           the run's test record
python -m live --replay record.csv --speed inf        as data=measured reads it
python -m live - --rate 120                           CSV or JSON lines, standard input
python -m live --listen 5000 --run FOLDER             the same from a socket on 127.0.0.1
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from data.arguments import Parser
from live.command_line import add_lines, add_source, choices_of, split_words
from runner.config.command_line import command_errors
from runner.loading import loading


def parser() -> Parser:
    """The options of the command line."""
    options = Parser(description=(__doc__ or "").splitlines()[0])
    add_source(options)
    add_lines(options)
    options.add_argument(
        "--sound", type=float, metavar="S", help="undamaged seconds at the start; then an alarm"
    )
    options.add_argument("--log", metavar="FOLDER", help="TensorBoard scalars")
    options.add_argument("--output", metavar="CSV", help="every estimate, a line each")
    options.add_argument("--force", action="store_true", help="overwrite --output")
    options.add_argument(
        "--every", type=float, default=5.0, metavar="S", help="between lines, without a terminal"
    )
    return options


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1, Ctrl-C in a summary and 130."""
    with command_errors():
        args = parser().parse_intermixed_args(words)
        kind, settings = split_words(args)
        choices = choices_of(kind, args, settings)
        with loading():  # takes seconds: a mistyped word is reported before
            from live.live import live
            from models.experiment import Experiment

        status = live(args, kind, settings, Experiment.of(choices))
    sys.exit(status)


if __name__ == "__main__":
    main()
