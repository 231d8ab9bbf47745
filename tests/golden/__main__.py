"""The golden values, compared with what this code computes, or made anew.

    python -m tests.golden                   every case
    python -m tests.golden vwnn units        some of them
    python -m tests.golden --make            writes values.json, and says what has changed in it

Numbers that changed are made anew for a new results version alone: raise RESULTS in
runner/config/identity.py first.
"""

from __future__ import annotations

import sys
import time

from data.arguments import Parser
from data.parallel import take_threads
from runner.config.command_line import command_errors
from runner.config.identity import RESULTS
from tests.golden.cases import CASES
from tests.golden.compare import Difference, differences, fault_of, platform, read, write


def main() -> int:
    """Exit status: 1 where the kept values are not those of this code, and are not made anew."""
    parser = Parser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--make", action="store_true", help="write what is computed")
    asked = parser.parse_args()
    names = asked.cases or list(CASES)
    if unknown := sorted({*names} - {*CASES}):
        raise ValueError(f"{unknown[0]} is no case; there are {', '.join(CASES)}")
    kept = read()
    if asked.make and asked.cases and kept["results"] != RESULTS:
        raise ValueError(f"all cases are made for a new results version; leave out {names[0]}")
    exact = kept["platform"] == platform()
    take_threads(1)
    now, found = {}, list[Difference]()
    for name in names:
        before = time.process_time()
        now[name] = CASES[name]()
        own = differences(name, kept["cases"].get(name, {}), now[name], exact)
        print(f"{name:<28}{time.process_time() - before:6.1f} s  {len(own) or 'no'} differences")
        found += own
    print(*found, sep="\n")
    fault = fault_of(found, kept["results"])
    if asked.make and not (kept["results"] == RESULTS and any(d.of_numbers for d in found)):
        write({name: values for name, values in kept["cases"].items() if name in CASES} | now)
        return 0
    print(fault or "the numbers are those that were kept")
    return int(bool(fault))


if __name__ == "__main__":
    with command_errors():
        sys.exit(main())
