"""Which models a kind of record allows, in the order of what they cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from data.measured.channels import signal_of

QUICK = (
    *("linear_state_space", "fir", "vwnn", "linear"),
    *("restoring_force_surface", "prandtl_ishlinskii"),
)


@dataclass(frozen=True)
class Candidate:
    """A model that is tried: its name in print, and the words that train it."""

    name: str
    words: tuple[str, ...]
    quick: bool = False  # a closed form, done in seconds

    @property
    def folder(self) -> str:
        """The name of its run's folder."""
        return "_".join(self.name.replace(",", "").split())


def _candidate(name: str, *words: str) -> Candidate:
    model = name.partition(",")[0]
    return Candidate(name, (f"model={model}", *words), model in QUICK)


def candidates(
    channels: Sequence[str], dt: float, states: bool = False, rates: bool = True
) -> list[Candidate]:
    """The models for records of these channels, sampled every dt [s]; plain models come first.

    states: x and v were measured beside a. rates: of an element under an imposed motion are known;
    without, forces follow the order of its deformations alone.
    """
    signals = {signal_of(channel) for channel in channels}
    if "r" in signals:
        return [*_of_element(signals, rates)]
    return [*_of_structure(signals, states, dt)]


def _of_element(signals: set[str], rates: bool) -> Iterator[Candidate]:
    """An element under an imposed motion; other inputs have a place in its units alone."""
    if rates and "u" not in signals:
        yield _candidate("restoring_force_surface, order 1", "model.order=1")
        yield _candidate("restoring_force_surface")
        yield _candidate("linear_state_space")
        yield _candidate("prandtl_ishlinskii")
        yield _candidate("element_test, named", "model.laws=named")
    yield _candidate("element_test, units", "model.laws=units")
    if rates and "u" not in signals:
        yield _candidate("element_test, branch", "model.laws=branch")


def _of_structure(signals: set[str], states: bool, dt: float) -> Iterator[Candidate]:
    """A structure under forces or on a base that moves; one driven by volts has no elements."""
    yield _candidate("linear_state_space")
    yield _candidate("fir")
    elements = "u" not in signals and "y" not in signals
    if elements:
        yield _candidate("vwnn", f"model.cutoff={1.0 / dt:.4g}")  # as fast as the samples tell
        if states:
            yield _candidate("linear")
        for laws in ("units", "named"):
            words = _OF_STATES.get(laws, ()) if states else (_READS[laws],)
            yield _candidate(f"element_network, {laws}", f"model.laws={laws}", *words)
    yield _candidate("modal_network")
    if elements:
        reads = () if states else (_READS["branch"],)
        yield _candidate("element_network, branch", "model.laws=branch", *reads)
        if states:
            yield _candidate("latent_hysteresis_network")
    else:
        yield _candidate("gru")


_OF_STATES: dict[str, tuple[str, ...]] = {
    "named": ("data.initial_state=rest",)
}  # measured x and v are noise there
_READS = {  # accelerations alone
    "named": "model.from_accelerations=true",
    "units": "model/reads=accelerations",
    "branch": "model.from_accelerations=true",
}
