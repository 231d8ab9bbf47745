"""No adaptation: the weights stay as they are."""

from __future__ import annotations

from typing import ClassVar

from models.online.laws import laws_compiled as compiled
from models.online.laws.law import Law


class Frozen(Law):
    """W ← W. For a model that was identified before, and as the measure of what adapting brings."""

    number: ClassVar[int] = compiled.FROZEN
