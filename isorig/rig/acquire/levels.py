"""Share of the range that each channel uses, and advice if it is very small or nearly all."""

from __future__ import annotations

from collections.abc import Mapping

from isorig.rig.acquire.policy import LARGE_SHARE, SMALL_SHARE


def shares(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> dict[str, float]:
    """Highest peak divided by full scale, for each channel with a known full scale."""
    return {name: peak / full_scale[name] for name, peak in highest.items() if full_scale.get(name, 0.0) > 0.0}


def advice(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> list[str]:
    """Advice on the levels, a sentence for each channel."""
    sentences = []
    for name, share in shares(highest, full_scale).items():
        if 0.0 < share < SMALL_SHARE:
            sentences.append(f"{name} uses {100.0 * share:.1g} % of its range: choose a smaller range or a higher gain.")
        elif share > LARGE_SHARE:
            sentences.append(f"{name} reaches {100.0 * share:.0f} % of its range: choose a larger range or a lower gain.")
    return sentences
