"""What a finished run's model is: masses, elements and modes with units; or its inputs.

python -m report.describe run=FOLDER
python -m report.describe run=zoo:element_network/bouc_wen
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from data.arguments import key_values
from runner.config.command_line import command_errors
from runner.folder.run_folder import require_finished, run_folder
from runner.loading import loading

KEYS = {"run": "FOLDER"}


def read_words(words: Sequence[str]) -> dict[str, str]:
    """{key: value} of the command line. Raises ValueError for other words."""
    found = key_values(words, KEYS)
    if "run" not in found:
        raise ValueError("which model? give run=FOLDER, the folder that train.py wrote")
    return found


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1."""
    words = sys.argv[1:] if words is None else words
    if {"-h", "--help"} & set(words):
        print(__doc__)
        return
    with command_errors():
        asked = read_words(words)
        folder = run_folder(asked["run"])
        require_finished(folder)
        with loading():  # takes seconds: a mistyped word is reported first
            from report.describe.description import describe

        describe(folder)


if __name__ == "__main__":
    main()
