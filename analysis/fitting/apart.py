"""What a rig's sensors can tell of its parameters: how well each is known after a run, and which act alike.

The sensitivity of all records to the free parameters at once (relative changes, weighted as in a fit) has one column a parameter.
Where columns depend on each other, some change of these parameters together leaves no trace: its direction is a right singular
vector with a singular value of zero (Bellman and Åström 1970, Math. Biosci. 7, 329, local structural identifiability).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.fitting.deviations import TRACE
from isorig.analysis.fitting.solve import Free, Problem, jacobian_of, positive
from isorig.analysis.fitting.trials import prepare
from isorig.analysis.model.rig_model import RigModel

#: Relative step of the finite differences: small against the width of a lightly damped peak, large against rounding.
STEP = 1e-6
#: Singular value of the columns, each of unit length, from which a direction leaves no trace: finite differences of `STEP` are
#: true to about 1e-5.
ALIKE = 1e-4
#: Share of such a direction from which a parameter takes part in it.
PART = 0.05
#: Times by which the others make a parameter less well known than it is alone, from which it hardly parts from them.
BLURRED = 30.0
#: Relative deviation from which that is worth saying.
POOR = 0.01


@dataclass(frozen=True, kw_only=True)
class Apart:
    """What the sensors tell.

    Parameters
    ----------
    paths
        The parameters.
    std
        Relative deviation of each (absolute where its value is zero) where every channel has noise of one hundredth of its rms;
        infinite where it cannot be told.
    silent
        Those that leave no trace at all.
    alike
        Groups that cannot be told apart: some change of all of them together leaves no trace.
    blurred
        Others that hardly part from the rest: their deviation is above `POOR`, and `BLURRED` times what it
        would be if all others were known.
    """

    paths: tuple[str, ...]
    std: FloatArray
    silent: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]
    blurred: tuple[str, ...]


def told_apart(model: RigModel, campaign: Campaign, paths: Sequence[str]) -> Apart:
    """What runs of a rig tell of parameters.

    Parameters
    ----------
    model
        The rig.
    campaign
        The runs; simulated ones will do.
    paths
        Dotted paths of the parameters in question.

    Raises
    ------
    DataError
        Where no run can be used.
    """
    problem = Problem(prepare(campaign, model))
    free = [replace(_free(path, model.get(path)), step=STEP) for path in paths]
    theta = np.array([f.encode(model.get(f.path)) for f in free])

    def build(coordinates: FloatArray) -> RigModel:
        return model.replace({f.path: f.decode(c) for f, c in zip(free, coordinates, strict=True)})

    residual = problem.residuals([model])[0]
    return apart_by(jacobian_of(problem, build, theta, free, residual), tuple(paths))


def apart_by(jacobian: FloatArray, paths: tuple[str, ...]) -> Apart:
    """What a sensitivity tells, shape (size, parameters), in deviations of the noise per relative change."""
    sizes = np.sqrt((jacobian**2).sum(axis=0))
    seen = np.flatnonzero(sizes >= TRACE)
    std = np.full(len(paths), np.inf)
    alike: list[tuple[str, ...]] = []
    blurred: tuple[str, ...] = ()
    if len(seen):
        _, values, ways = np.linalg.svd(jacobian[:, seen] / sizes[seen], full_matrices=False)
        lost = ways[values < ALIKE * values[0]]
        # Directions that leave no trace may be mixed at will: parameters belong together where a projection joins them.
        joined = np.abs(lost.T @ lost) > PART**2
        taking = joined.diagonal()
        for group in _groups(joined):
            if taking[group[0]]:
                alike.append(tuple(paths[seen[k]] for k in group))
        kept = values >= ALIKE * values[0]
        inflated = np.sqrt(((ways[kept] / values[kept, None]) ** 2).sum(axis=0))
        std[seen] = np.where(taking, np.inf, inflated / sizes[seen])
        blurred = tuple(paths[seen[k]] for k in range(len(seen)) if inflated[k] > BLURRED and POOR < std[seen[k]] < np.inf)
    return Apart(
        paths=paths, std=std, silent=tuple(path for k, path in enumerate(paths) if k not in seen), alike=tuple(alike),
        blurred=blurred,
    )  # fmt: skip


def _groups(joined: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> list[list[int]]:
    left, groups = set(range(len(joined))), []
    while left:
        group, way = [], [min(left)]
        while way:
            k = way.pop()
            if k in left:
                left.remove(k)
                group.append(k)
                way += [int(j) for j in np.flatnonzero(joined[k])]
        groups.append(sorted(group))
    return groups


def _free(path: str, value: float) -> Free:
    return positive(path, value) if value > 0.0 else Free(path=path, low=-np.inf, log=False)
