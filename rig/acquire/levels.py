"""How much of its range each channel uses, and what to do where that is little or nearly all."""

from __future__ import annotations

from collections.abc import Mapping

#: Shares of the range: below the first an input's own noise and steps are seen in the result, above the second a burst clips.
LOW, HIGH = 0.03, 0.80


def shares(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> dict[str, float]:
    """Highest peak over full scale of each channel whose full scale is known."""
    return {name: peak / full_scale[name] for name, peak in highest.items() if full_scale.get(name, 0.0) > 0.0}


def advice(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> list[str]:
    """What to do about the levels, a sentence for each channel."""
    told = []
    for name, share in shares(highest, full_scale).items():
        if 0.0 < share < LOW:
            told.append(f"{name} uses {100.0 * share:.1g} % of its range: choose a smaller range, or more gain.")
        elif share > HIGH:
            told.append(f"{name} reaches {100.0 * share:.0f} % of its range: choose a larger range, or less gain.")
    return told
