"""A record as CSV lines on standard output, at real speed: a stand-in for sensors.

python -m live.samples simulation system=bouc_wen | python -m live - --rate 100
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from data.arguments import Parser
from live.command_line import RECORDED, add_source, choices_of, split_words
from runner.config.command_line import command_errors
from runner.loading import loading


def samples(words: Sequence[str] | None = None) -> None:
    """Print the lines of the record that the words name. Raises ValueError, OSError."""
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add_source(parser)
    args = parser.parse_intermixed_args(words)
    kind, settings = split_words(args)
    if kind not in (*RECORDED, "replay"):
        raise ValueError(f"{kind} is no record; choose simulation, test or --replay PATH")
    choices = choices_of(kind, args, settings)
    with loading():  # takes seconds: a mistyped word is reported first
        from live.source import lines_of, recorded
        from models.experiment import Experiment

    record, sensors = recorded(kind, args, Experiment.of(choices))
    for line in lines_of(record, sensors.forced == "base", args.speed):
        print(line, flush=True)


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line; a reader that has ended and Ctrl-C end the program silently."""
    with command_errors():
        try:
            samples(words)
        except BrokenPipeError:
            # Python would complain, on leaving, of lines that nobody reads any more
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
