"""All candidates compared with all figures of the thesis, and selection of the page's candidate."""

from __future__ import annotations

from collections.abc import Mapping

from thesis.campaign import Played, candidates, played
from thesis.figures import Seen, distance, figures, seen, values
from thesis.published_values import MOST
from thesis.step import Step

#: Smaller differences in distance do not distinguish two candidates: one figure more or less has the same effect.
NEAR = 0.2

Compared = Mapping[str, tuple[Seen, dict[str, float]]]


def compared(share: float = 1.0) -> Compared:
    """Every candidate's campaign with all its figures, by the candidate's name."""
    found = {candidate.name: seen(played(candidate, share)) for candidate in candidates()}
    return {name: (item, values(item)) for name, item in found.items()}


def base(found: Compared) -> Seen:
    """The candidate with the smallest distance from the thesis over all figures."""
    return min(found.values(), key=lambda pair: distance(pair[1]))[0]


def rivals(found: Compared) -> Step:
    """The table of all candidates and figures."""
    chosen: Played = base(found).played
    rows = []
    for figure in figures():
        key = f"{figure.where}: {figure.what}"
        cells = [
            f"{values_[key]:.3g}: {figure.stated.verdict(values_[key])}, {figure.stated.tolerances(values_[key]):.1f}"
            for _, values_ in found.values()
        ]
        rows.append((figure.where, figure.what, figure.stated.shown, *cells))
    far = {name: distance(values_) for name, (_, values_) in found.items()}
    against = {
        name: sum(figure.stated.verdict(values_[f"{figure.where}: {figure.what}"]) != "agrees" for figure in figures())
        for name, (_, values_) in found.items()
    }
    rows.append(("all", "figures that do not agree", f"of {len(figures())}", *(f"{count}" for count in against.values())))
    rows.append(("all", "**distance**", "", *(f"**{value:.2f}**" for value in far.values())))
    order = sorted(far, key=lambda name: far[name])
    apart = far[order[1]] - far[order[0]]
    first = next(iter(found))
    missed = "; ".join(
        f"{figure.where}, {figure.what}"
        for figure in figures()
        if figure.stated.tolerances(found[first][1][f"{figure.where}: {figure.what}"]) >= MOST
    )
    text = [
        f"**The rig of this page** is the candidate with the smallest distance: {chosen.candidate.name}. The distance is the "
        "root mean square, over all figures, of the difference from the stated range in tolerances, which is 0 within the range "
        f"and at most {MOST:g}; this difference follows every verdict.",
        f"The distance of the next candidate, {order[1].lower() if not order[1][0].isdigit() else order[1]}, is {apart:.2f} "
        "larger"
        + (
            f", less than the {NEAR:g} that one figure more or less changes: the printed figures do not distinguish the two, "
            "only a measurement at two gains does (the plan above)."
            if apart < NEAR
            else "."
        ),
        f"{first}, the rig that the thesis itself simulates, has a distance of {far[first]:.2f}. It contradicts: "
        f"{missed or 'nothing'}.",
        "The 98 % and 60 % are not included: the first is the same for all, and the acceleration of the second is not given.",
    ]
    heads = ("where", "what", "thesis (tolerance)", *found)
    return Step(title="Which rig agrees best with the thesis", text=text, tables=[(heads, rows)])
