"""The message of what the equations of motion tell of a run while it is measured."""

from __future__ import annotations

import msgspec


class EquationsReport(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the equations of motion tell of a run from its first `seconds`.

    The residual of each equation is over noise: about one if it holds, as it does up to `limit`. `known` is whether the answer is
    certain, `text` the answer in words, empty without one.
    """

    run: str
    seconds: float
    residuals: dict[str, float]
    limit: float
    known: bool
    text: str

    @property
    def sentence(self) -> str:
        """The answer in a sentence."""
        return f"{self.run}, from {self.seconds:.0f} s: {self.text or 'no answer yet'}" + (", certain" if self.known else "")
