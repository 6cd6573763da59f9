"""Contacts that stick at the same time: how they share the force, which others they block, how they break away.

Rows are the contacts' directions in mass-normalised coordinates, shape (contacts, n): a contact's speed is its row times the
coordinates' speeds. Where contacts form a loop (two between the same bodies, or motor-table, table-ground and motor-ground)
the rows are linearly dependent, and the motion does not determine their forces.
"""

from itertools import combinations

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Share of a row below which its remainder after projection onto others is rounding.
ROUNDING = 1e-9


def shared(rows: FloatArray, grips: FloatArray) -> FloatArray:
    """Matrix from relative accelerations to the forces of the sticking contacts that cancel them, shape (contacts, contacts).

    If the motion does not determine the forces, the sum of force^2 / grip is minimised: parallel contacts share the force in
    proportion to their breakaway forces.

    `rows` are the directions, shape (contacts, n), and `grips` the breakaway forces in N, shape (contacts,).
    """
    compliance = rows @ rows.T
    if len(rows) == 1:
        return np.asarray(1.0 / compliance)
    root = np.sqrt(grips)
    scale = 1.0 / np.sqrt(np.diag(compliance))
    weighted = scale[:, None] * compliance * root
    return np.asarray(root[:, None] * np.linalg.pinv(weighted, rcond=ROUNDING) * scale)


def implied(rows: FloatArray, held: list[int], others: list[int]) -> list[int]:
    """Those of the other contacts that cannot slide while the held ones stick."""
    if not held or not others:
        return []
    _, sizes, right = np.linalg.svd(_unit(rows[held]), full_matrices=False)
    span = right[sizes > ROUNDING]
    left = _unit(rows[others])
    rest = np.abs(left - left @ span.T @ span).max(axis=1)
    return [k for k, size in zip(others, rest, strict=True) if size <= ROUNDING]


def patterns(rows: FloatArray) -> FloatArray:
    """Patterns of relative speeds in which as few sticking contacts as possible slide, shape (patterns, contacts).

    Independent contacts break away one by one. In a loop none slides alone: the contacts stick as long as for every pattern c
    the power of the static forces, sum c f, does not exceed that of the breakaway forces, sum |c| F (these are the facets of
    the set of forces that they can bear together).
    """
    count = len(rows)
    if count == 1:
        return np.ones((1, 1))
    sizes = np.linalg.norm(rows, axis=1)
    _, singular, right = np.linalg.svd(rows / sizes[:, None], full_matrices=False)
    span = right[singular > ROUNDING]
    rank = len(span)
    if rank == count:
        return np.eye(count)
    found: list[FloatArray] = []
    reduced = rows @ span.T
    for rest in combinations(range(count), rank - 1):
        _, singular, right = np.linalg.svd(reduced[list(rest)] / sizes[list(rest), None])
        if rank > 1 and singular.min() <= ROUNDING:
            continue
        speeds = reduced @ right[-1]
        speeds[np.abs(speeds) <= ROUNDING * sizes] = 0.0
        speeds /= speeds[np.argmax(np.abs(speeds))]
        if not any(np.allclose(speeds, other) or np.allclose(speeds, -other) for other in found):
            found.append(speeds)
    return np.array(found)


def _unit(rows: FloatArray) -> FloatArray:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
