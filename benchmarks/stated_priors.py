"""Does a stated prior count as much as it should beside records, and is a wrong one told?

    python -m benchmarks.stated_priors --draws 30        # some 3 s a draw, three kinds

Two masses on elements that yield, a record of 6 s with noise of 10 %. The prior of a damper is
drawn about the truth with the deviation that it states, or six of them off. The interval should be
as wide as records and prior are together, and hold the truth in 95 % of draws.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.signal import lfilter

from data.arguments import Parser
from data.record import Drive, Record, stack
from models.element_network import ElementNetwork
from models.training.by_noise import refit
from models.training.problem import FreeRunProblem
from models.uncertainty.intervals import Interval, intervals_of
from models.uncertainty.laplace import CONTRADICTED, Laplace, laplace
from runner.config.command_line import command_errors

DT, SAMPLES, NOISE = 0.01, 600, 0.1
NAME, DAMPER, SHARE = "r1.damping", 0.8, 0.1  # N s/m, relative standard deviation of its prior
KINDS = {  # in words: the noise's next sample is so much of the one before; deviations off
    "white noise": (0.0, 0.0),
    "slow noise": (0.95, 0.0),
    "prior six deviations off": (0.0, 6.0),
}


def planted(**stated: Any) -> ElementNetwork:
    """A chain of two masses."""
    chain = [["ground", "x1"], ["x1", "x2"]]
    model = ElementNetwork(2, 2, DT, chain, None, hinges=0, units=1, cubic=False, **stated)
    stiffness = torch.tensor([80.0, 50.0], dtype=torch.float64)
    model.mass.start(torch.tensor([1.0, 1.5], dtype=torch.float64))
    model.laws.start(stiffness, 0.01 * stiffness, 0.1 * torch.ones_like(stiffness), (0.5, 0.5))
    model.laws.unit_stiffness.theta.data.fill_(0.6)
    model.identified.fill_(1.0)
    model.keep_start()
    return model


def measured(rng: np.random.Generator, colour: float) -> Record:
    """A noisy record as a batch of one."""
    f = lfilter([1.0], [1.0, -1.8, 0.85], rng.standard_normal((SAMPLES, 2)), axis=0)
    rest = torch.zeros(2, dtype=torch.float64)
    drive = Drive(DT, torch.from_numpy(5.0 * f / f.std()), rest, rest)
    with torch.no_grad():
        a = planted().free_run(drive).a
    noise = rng.standard_normal((SAMPLES + 200, 2))
    noise = lfilter([(1.0 - colour**2) ** 0.5], [1.0, -colour], noise, axis=0)[200:].copy()
    return stack([Record(DT, a + NOISE * a.std() * torch.from_numpy(noise), drive.u)])


def fitted(record: Record, value: float, share: float) -> tuple[Interval, Laplace]:
    """The damper's interval, and Laplace's approximation, from the truth on."""
    model = planted(priors={NAME: [value, share]})
    model.admitted([record])
    refit(model, record, lambda r: FreeRunProblem(model, r, None), "equal", None, lambda _: None)
    found = laplace(model, [record])
    assert found is not None
    return next(i for i in intervals_of(model, found) if i.name == NAME), found


def row(draws: int, colour: float, off: float) -> list[float]:
    """Half widths [%]: records alone, both, as they should be; covered and contradicted [%]."""
    rng = np.random.default_rng(0)
    halves, covered, told = [], [], []
    for _ in range(draws):
        record = measured(rng, colour)
        alone, _ = fitted(record, DAMPER, 1e6)
        stated = DAMPER * float(np.exp(SHARE * (rng.standard_normal() + off)))
        both, found = fitted(record, stated, SHARE)
        halves.append([alone.half / alone.value, both.half / both.value])
        covered.append(abs(both.value - DAMPER) <= both.half)
        told.append(bool(np.abs(found.tension[0]) > CONTRADICTED))
    one, other = (100.0 * float(h) for h in np.median(halves, axis=0))
    wanted = (one**-2 + (196.0 * SHARE) ** -2) ** -0.5
    return [one, other, wanted, 100.0 * float(np.mean(covered)), 100.0 * float(np.mean(told))]


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--draws", type=int, default=30)
    parser.add_argument("--quick", action="store_true", help="two draws")
    options = parser.parse_args(given)
    with command_errors():
        heads = ("records ± %", "both ± %", "should be", "covered %", "contradicted %")
        print(f"{'':<26}" + "".join(f"{head:>15}" for head in heads))
        for words, (colour, off) in KINDS.items():
            values = row(2 if options.quick else options.draws, colour, off)
            print(f"{words:<26}" + "".join(f"{value:>15.1f}" for value in values), flush=True)


if __name__ == "__main__":
    main()
