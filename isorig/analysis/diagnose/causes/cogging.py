"""A force that repeats with the position."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Periodic
from isorig.analysis.model.rig_model import Link, RigModel

#: Phases of the starting values, rad, of which the recorded force selects one.
PHASES = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)
#: Force of the starting values as a share of the link's largest force.
SHARE = 0.1
#: Range of a fitted pitch, relative to that from the equations. Chosen: the neighbouring periods over the range are beyond it.
WITHIN = 1.2


class Cogging(LinkCause):
    """A force that repeats with the position (the cogging of a motor, the meshing of teeth, once per turn a heavy side).

    The force is a sin(2 pi d / pitch + phase), over at least two periods, or of once per turn. It is proposed where the equations
    of motion show a pitch, or a force over the angle of a body that no spring holds.
    """

    kind = "spring_shape"
    family = "spring"
    rank = 2
    law = Periodic
    found_as = frozenset({"force periodic in position"})
    phrase = "a force in the {place} that repeats with the position, amplitude {periodic_force}, pitch {pitch}"

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return True

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        pitch = evidence.pitches.get(link.name)
        if pitch is not None:
            for phase in PHASES:
                yield link.having(Periodic(periodic_force=SHARE * _scale(link), pitch=pitch, phase=phase))

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        """As for every law, with the pitch near the one from the equations; see `WITHIN`.

        The force is bounded where the lighter body would vibrate in it at half the sample rate: no record shows more, and
        simulations would take very short steps.
        """
        pitch = evidence.pitches.get(place, np.inf)
        steepest = model.constants_of(model.link(place)).mass * (np.pi * evidence.sample_rate) ** 2
        for candidate in super().proposed(model, evidence, place):
            force, period, phase = candidate.free
            force = replace(force, high=min(force.high, max(steepest * pitch / (2.0 * np.pi), 2.0 * force.low)))
            yield replace(candidate, free=(force, replace(period, low=pitch / WITHIN, high=pitch * WITHIN), phase))

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        return (
            Free(path="periodic_force", low=1e-4 * _scale(link), high=1e2 * _scale(link)),
            Free(path="pitch"),
            Free(path="phase", low=-np.inf, log=False, step=1e-3, turn=2.0 * np.pi),
        )

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Periodic:
        force = size * sizes.weak_to_strong(0.1, 0.3) * _scale(link)
        pitch, phase = sizes.between(0.2, 0.6) * link.deflection, sizes.between(-np.pi, np.pi)
        return Periodic(periodic_force=force, pitch=pitch, phase=phase)

    def smallest(self, model: RigModel, runs: Amplitudes, place: str) -> Iterable[RigWithCause]:
        """Nothing: every run that moves the link over two periods shows it, so no proposal depends on it."""
        return ()


def _scale(link: LinkInRuns) -> float:
    # The link's largest force, N.
    return max(link.stiffness * link.deflection, link.resistance)
