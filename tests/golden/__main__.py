"""The golden values, compared with what this code computes, or made anew.

python -m tests.golden                   every case
python -m tests.golden vwnn units        some of them
python -m tests.golden --make            writes values.json, and says what has changed in it
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter

from data.parallel import take_threads
from tests.golden.cases import CASES
from tests.golden.compare import differences, platform, read, write


def main() -> int:
    """Exit status: 1 where a number differs from the kept one and none is made anew."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], metavar="case")
    parser.add_argument("--make", action="store_true", help="write what is computed")
    asked = parser.parse_args()
    kept, names = read(), asked.cases or list(CASES)
    exact = kept["platform"] == platform()
    take_threads(1)
    found, lines = {}, []
    for name in names:
        before = time.process_time()
        found[name] = CASES[name]()
        own = differences(name, kept["cases"].get(name, {}), found[name], exact)
        print(f"{name:<28}{time.process_time() - before:6.1f} s  {len(own) or 'no'} differences")
        lines += own
    print("\n".join(lines))
    if asked.make:
        others = {name: values for name, values in kept["cases"].items() if name in CASES}
        write(others | found)
    return int(bool(lines) and not asked.make)


if __name__ == "__main__":
    sys.exit(main())
