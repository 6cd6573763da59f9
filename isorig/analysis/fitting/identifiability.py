"""Identifiability: how well runs determine a rig's parameters, and which parameters are indistinguishable.

The sensitivity of all records to the parameters (relative changes, weighted as in a fit) has one column for each parameter. Where
columns depend linearly on each other, a joint change of these parameters has no effect on any record: its direction is a right
singular vector with a singular value of zero (Bellman and Åström 1970, Math. Biosci. 7, 329, local structural identifiability).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.fitting.influence import TRACE
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import Free, at_coordinates, coordinates_of, jacobian_of, positive
from isorig.analysis.model.rig_model import RigModel

#: Relative step of the finite differences: small compared with the width of a lightly damped peak, large compared with rounding.
STEP = 1e-6
#: Singular value, relative to the largest one of columns of unit length, below which a direction has no effect: finite
#: differences of `STEP` are accurate to about 1e-5.
NO_EFFECT = 1e-4
#: Component of such a direction from which a parameter belongs to it.
COMPONENT = 0.05
#: Ratio of a parameter's uncertainty to its uncertainty with all others known, from which it is reported as correlated.
INFLATED = 30.0
#: Relative uncertainty below which a correlated parameter is known well enough all the same.
POOR = 0.01


@dataclass(frozen=True, kw_only=True)
class Identifiability:
    """How well runs determine parameters."""

    paths: tuple[str, ...]  #: The parameters.
    #: Standard uncertainty of each, shape (parameters,), relative to its value (absolute where the value is zero), for noise of 1
    #: % of its rms on every channel; infinite where it is not identifiable.
    std: FloatArray
    without_effect: tuple[str, ...]  #: Parameters that have no effect on any record.
    indistinguishable: tuple[tuple[str, ...], ...]  #: Groups of parameters of which a joint change has no effect on any record.
    #: Other parameters whose uncertainty is above `POOR` and `INFLATED` times what it would be with all others known.
    correlated: tuple[str, ...]


def identifiability(model: RigModel, campaign: Campaign, paths: Sequence[str]) -> Identifiability:
    """How well a campaign, measured or simulated, determines parameters.

    Parameters
    ----------
    model
        The rig.
    campaign
        The runs.
    paths
        Dotted paths of the parameters.

    Raises
    ------
    DataError
        Where no run can be used.
    """
    problem = Problem(prepare(campaign, model))
    free = [replace(_free(path, model.get(path)), step=STEP) for path in paths]
    residual = problem.residuals([model])[0]
    build = partial(at_coordinates, model, free)
    return from_sensitivity(jacobian_of(problem, build, coordinates_of(model, free), free, residual), tuple(paths))


def from_sensitivity(jacobian: FloatArray, paths: tuple[str, ...]) -> Identifiability:
    """Identifiability from a sensitivity, shape (size, parameters), in noise deviations per relative change."""
    sizes = np.sqrt((jacobian**2).sum(axis=0))
    seen = np.flatnonzero(sizes >= TRACE)
    std = np.full(len(paths), np.inf)
    groups: list[tuple[str, ...]] = []
    correlated: tuple[str, ...] = ()
    if len(seen):
        _, values, directions = np.linalg.svd(jacobian[:, seen] / sizes[seen], full_matrices=False)
        kept = values >= NO_EFFECT * values[0]
        lost = directions[~kept]
        # The directions without effect span a space in which any basis may be chosen; its projector does not depend on that.
        joined = np.abs(lost.T @ lost) > COMPONENT**2
        part_of = joined.diagonal()
        groups = [tuple(paths[seen[k]] for k in group) for group in _groups(joined) if part_of[group[0]]]
        inflation = np.sqrt(((directions[kept] / values[kept, None]) ** 2).sum(axis=0))
        std[seen] = np.where(part_of, np.inf, inflation / sizes[seen])
        correlated = tuple(
            paths[k] for k, ratio in zip(seen, inflation, strict=True) if ratio > INFLATED and POOR < std[k] < np.inf
        )
    return Identifiability(
        paths=paths, std=std, without_effect=tuple(path for k, path in enumerate(paths) if k not in seen),
        indistinguishable=tuple(groups), correlated=correlated,
    )  # fmt: skip


def _groups(joined: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> list[list[int]]:
    # Connected components.
    left, groups = set(range(len(joined))), []
    while left:
        group, queue = [], [min(left)]
        while queue:
            k = queue.pop()
            if k in left:
                left.remove(k)
                group.append(k)
                queue += [int(j) for j in np.flatnonzero(joined[k])]
        groups.append(sorted(group))
    return groups


def _free(path: str, value: float) -> Free:
    return positive(path, value) if value > 0.0 else Free(path=path, low=-np.inf, log=False)
