"""Which models a kind of record allows, in the order of what they cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from data.measured.channels import has_gaps, numbered, signal_of

QUICK = (
    *("linear_state_space", "linear_motion", "fir", "vwnn"),
    *("restoring_force_surface", "prandtl_ishlinskii"),
)
SELDOM = ("element_network, branch", "latent_hysteresis_network")


@dataclass(frozen=True)
class Candidate:
    """A model that is tried: its name in print, and the words that train it."""

    name: str
    words: tuple[str, ...]
    quick: bool = False  # a closed form, done in seconds
    seldom: bool = False  # seldom the best of all: it gets less time than those before it

    @property
    def folder(self) -> str:
        """The name of its run's folder."""
        return "_".join(self.name.replace(",", "").split())


def _candidate(name: str, *words: str) -> Candidate:
    model = name.partition(",")[0]
    return Candidate(name, (f"model={model}", *words), model in QUICK, name in SELDOM)


def candidates(
    channels: Sequence[str], dt: float, states: str = "", rates: bool = True
) -> list[Candidate]:
    """The models for records of these channels, sampled every dt [s]; plain models come first.

    states: "xv" where x and v were measured beside a, "x" where x was. rates: of an element under
    an imposed motion are known; without, forces follow the order of its deformations alone.
    """
    signals = {signal_of(channel) for channel in channels}
    if "r" in signals:
        return [*_of_element(signals, rates)]
    own = numbered(channels, "a") or numbered(channels, "x")
    others = numbered(channels, "x") + numbered(channels, "drift")
    hidden = has_gaps(own) or max(others, default=0) > max(own, default=0)
    return [*_of_structure(signals, states, dt, hidden)]


def _of_element(signals: set[str], rates: bool) -> Iterator[Candidate]:
    """An element under an imposed motion; other inputs have a place in its units alone."""
    if rates and "u" not in signals:
        yield _candidate("restoring_force_surface, order 1", "model.order=1")
        yield _candidate("restoring_force_surface")
        yield _candidate("linear_state_space")
        yield _candidate("prandtl_ishlinskii")
    if "u" not in signals:
        yield _candidate("element_test, named", "model.laws=named")
    yield _candidate("element_test, units", "model.laws=units")
    if rates and "u" not in signals:
        yield _candidate("element_test, branch", "model.laws=branch")


def _of_structure(signals: set[str], states: str, dt: float, hidden: bool) -> Iterator[Candidate]:
    """A structure under forces or on a base that moves; one driven by volts has no elements.

    hidden: some floors have no sensor: of a chain on a base, named laws alone tell their drifts.
    """
    yield _candidate("linear_state_space")
    yield _candidate("linear_motion")
    yield _candidate("fir")
    elements = "u" not in signals and "y" not in signals
    if not elements:
        yield _candidate("modal_network")
        yield _candidate("gru")
        return
    yield _candidate("vwnn", f"model.cutoff={1.0 / dt:.4g}")  # as fast as the samples tell
    yield _network("named", states)
    if not hidden or "f" in signals:
        yield _network("units", states)
    yield _candidate("modal_network")
    if not hidden:
        yield _network("branch", states)
    if states == "xv":
        yield _candidate("latent_hysteresis_network")


def _network(laws: str, states: str) -> Candidate:
    words = [f"model.laws={laws}"]
    if laws == "units" and states != "xv":
        words.append("model/reads=accelerations")
    if laws == "named" and states == "xv":
        words.append("data.initial_state=rest")  # x, v are noisy
    return _candidate(f"element_network, {laws}", *words)
