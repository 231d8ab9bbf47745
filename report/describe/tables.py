"""Tables of a model's parameters and modes within 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from export.modes import Modes
from models.estimator import Parameter
from report.prediction.table import number

WIDTH = 80
MOST = 40  # rows of a table; the JSON has all
SHAPES = 5  # DOFs whose shapes are in the table
HEADS = {  # quantity → heading of the elements' table
    "stiffness": "stiffness\n[N/m]",
    "damping": "damping\n[N s/m]",
    "yield_displacement": "yields at\n[m]",
    "activation_displacement": "opens at\n[m]",
    "yield_force": "force\n[N]",
    "activation_force": "force\n[N]",
    "post_yield_ratio": "post-\nyield",
    "hardening_ratio": "post-\nyield",
    "gap": "gap\n[m]",
}
SPACES = str.maketrans("_.", "  ")
FEW = 6  # parameters that need no table
MATTERS = 0.01  # of an element's stiffness: terms that are printed
NO_WORDS = ("post_yield_stiffness",)  # which the ratio says


def print_elements(
    console: Console, parameters: Sequence[Parameter], trained: Mapping[str, Any]
) -> None:
    """Masses, and a line for each element: what every law has, as far as training went."""
    masses = [p for p in parameters if p.name.endswith(".mass")]
    if masses:
        listed = ", ".join(f"{p.name.partition('.')[0]} {number(p.value)}" for p in masses[:MOST])
        console.print(f"masses [kg]: {listed}{', …' if len(masses) > MOST else ''}")
    elements = _elements(parameters)
    if not elements:
        return
    table = Table()
    table.add_column("element", no_wrap=True)
    heads = list(dict.fromkeys(HEADS[q] for q in HEADS if any(q in e for e in elements.values())))
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for name, own in list(elements.items())[:MOST]:
        about = next(iter(own.values())).about.partition(",")[0]
        pair = f" {about}" if "–" in about else ""
        if not set(own) & set(HEADS):
            continue
        untold = _beyond(own, _reached(name, trained))
        seen = {q: p for q, p in own.items() if q in HEADS and q not in untold}
        cells = {HEADS[q]: _cell(q, p.value) for q, p in seen.items()}
        table.add_row(f"{name}{pair}", *(cells.get(head, "–") for head in heads))
    table.caption_justify = "left"
    if any("post_yield_stiffness" in own for own in elements.values()):
        table.caption = "post-yield: stiffness after an element has yielded, over the initial one"
    if len(elements) > MOST:
        table.caption = f"{MOST} of {len(elements)} elements"
    console.print(table)


def _reached(name: str, trained: Mapping[str, Any]) -> float | None:
    """The largest deformation [m] of an element in training, where it is known."""
    sizes = trained.get("deformation", {}).get("largest", [])
    number_of = int(name.partition(" ")[0][1:]) - 1
    return sizes[number_of] if number_of < len(sizes) else None


def _beyond(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Quantities of an element that its training never reached: they are not printed."""
    if largest is None:
        return []
    found = ["gap"] if "gap" in own and own["gap"].value > largest else []
    if "yield_displacement" in own and own["yield_displacement"].value > largest:
        found += ["yield_displacement", "yield_force"]
    return found


def _cell(quantity: str, value: float) -> str:
    """Of seven characters, or eight below zero, so that six columns fit: 2.71e-5."""
    if quantity.endswith("_ratio") and abs(value) < 1000.0:
        return f"{value:z.3f}"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return number(value, 4 if abs(value) >= 0.01 else 3)
    return f"{value:.2e}".replace("e-0", "e-").replace("e+0", "e")


def _elements(parameters: Sequence[Parameter]) -> dict[str, dict[str, Parameter]]:
    """{"r1": {"stiffness": …}}: parameters of the elements, by what they are."""
    found: dict[str, dict[str, Parameter]] = {}
    for p in parameters:
        part, _, quantity = p.name.partition(".")
        if part[0] == "r" and part[1:].isdigit():
            law, _, rest = quantity.partition(".")
            if law.startswith("law_"):
                part, quantity = f"{part} {law.replace('_', ' ')}", rest
            found.setdefault(part, {})[quantity] = p
    return found


def print_rest(
    console: Console, parameters: Sequence[Parameter], trained: Mapping[str, Any]
) -> None:
    """Print further parameters: repeated terms, and those of named laws."""
    elements = _elements(parameters)
    lines = []
    for name, own in list(elements.items())[:MOST]:
        largest = _reached(name, trained)
        words = [*_terms(own, largest), *_others(own, largest)]
        about = next(iter(own.values())).about.partition(", ")[2]
        if words or about:
            lines.append(
                f"{name}{f' {about}' if about else ''}: {', '.join(words) or 'no more terms'}"
            )
    for line in lines:
        console.print(line)
    others = [p for p in parameters if p.name[0] != "r" and not p.name.endswith(".mass")]
    if others and len(others) <= FEW:
        words = [
            f"{p.name.replace('_', ' ').replace('.', ' ')} {number(p.value)} {p.unit}".strip()
            for p in others
        ]
        console.print("; ".join(words))
        return
    if others:
        table = Table()
        for head in ("parameter", "value", "unit"):
            table.add_column(head, justify="right" if head == "value" else "left")
        for p in others[:MOST]:
            table.add_row(p.name, number(p.value), p.unit)
        table.caption = others[0].about or None
        if len(others) > MOST:
            table.caption = f"{MOST} of {len(others)}; {others[0].about}".rstrip("; ")
        console.print(table)


def _terms(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Hinges, tanhs and units that are a notable part of an element."""
    k = abs(own["stiffness"].value) if "stiffness" in own else 0.0
    groups = dict.fromkeys(q.partition(".")[0] for q in own if "." in q)
    terms = []
    for group in groups:
        at = {q.partition(".")[2]: p.value for q, p in own.items() if q.startswith(f"{group}.")}
        size = at.get("stiffness")
        if size is not None and abs(size) < MATTERS * k:
            continue
        place = at.get("yield_displacement", at.get("gap", at.get("place", at.get("half_width"))))
        word = {"hinge": "beyond", "unit": "yields at", "slider": "slips at"}.get(
            group.partition("_")[0], "about"
        )
        beyond = largest is not None and place is not None and place > largest
        never = ", not reached in training" if beyond else ""
        stiff = f" of {number(size)} N/m" if size is not None else ""
        if place is not None:
            terms.append(f"{group.partition('_')[0]}{stiff} {word} {number(place)} m{never}")
        elif at.get("force"):
            saturates = number(at.get("saturates_at"))
            terms.append(f"{number(at['force'])} N that saturate at {saturates} m/s")
    return terms


def _others(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Parameters of an element without a column or a term, that have an effect."""
    k = own["stiffness"].value if "stiffness" in own else 0.0
    others = []
    for q, p in own.items():
        power = {"cubic_stiffness": 2, "quadratic_stiffness": 1}.get(q)
        faint = power and largest and abs(p.value) * largest**power < MATTERS * k
        if q not in HEADS and "." not in q and q not in NO_WORDS and p.value != 0.0 and not faint:
            others.append(f"{q.replace('_', ' ')} {number(p.value)} {p.unit}".strip())
    return others


def print_modes(console: Console, modes: Modes) -> None:
    """Frequency, damping ratio and shape of small motions."""
    dofs = len(modes.shapes)
    table = Table(title="modes of small motions", title_justify="left")
    for head in ("mode", "frequency\n[Hz]", "damping\nratio [%]"):
        table.add_column(head, justify="right")
    shown = range(min(dofs, SHAPES)) if dofs > 1 else ()
    for i in shown:
        table.add_column(f"x{i + 1}", justify="right")
    rows = zip(modes.frequencies, modes.damping, modes.shapes.T, strict=True)
    for i, (frequency, damping, shape) in list(enumerate(rows, start=1))[:MOST]:
        cells = [f"{shape[j].real:.3f}" for j in shown]
        table.add_row(str(i), number(frequency), number(100.0 * damping, 3), *cells)
    if not len(modes.frequencies):
        console.print("no modes: small motions do not oscillate")
        return
    console.print(table)
    if dofs > SHAPES:
        console.print(f"shapes of all {dofs} DOFs: in the picture")
    if modes.unstable.any():
        console.print("modes of negative damping grow: the model is unstable about rest")
