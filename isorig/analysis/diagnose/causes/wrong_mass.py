"""A wrong given mass."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RigWithCause, Sizes, beyond_calibration
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Factors on a given mass from which its fits start, besides the given value.
FACTORS = (0.6, 1.6)


class WrongMass(Cause):
    """A mass that differs from its given value."""

    kind = "known_value"
    family = "mass"
    rank = 0
    phrase = "the mass of the {place} is {mass}"
    signs = frozenset({"independent of amplitude"})
    found_as = frozenset({"mass", "gain"})
    at_bodies = True

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The drive's channel if its force is mass times acceleration, and the weighed bodies."""
        by_mass = model.drive.quantity == "acceleration" and model.drive.imposes is None
        weighed = [body.name for body in model.bodies if not body.name.endswith("_added") and body.name != "rocking"]
        places = [*([model.drive.channel] if by_mass else []), *weighed]
        return tuple(place for place in places if _path(model, place) not in model.free)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        if _scale_is_free(evidence.described):
            return
        path = _path(model, place)
        given = model.get(path)
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank, starts=(model, *_heavier(model, path, place)),
            free=(Free(path=path, low=0.2 * given, high=5.0 * given),), reported=(Reported(name="mass", path=path, unit="kg"),),
            twin=("sensor_gain", place) if path == "drive.factor" else None, plausible=beyond_calibration(path, given),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        path = _path(model, place)
        mass = model.get(path) * (1.0 + sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.06, 0.15))
        return RigWithCause(model=model.replace({path: mass}), parameters={"mass": mass})


def _path(model: RigModel, place: str) -> str:
    return f"bodies.{place}.mass" if any(body.name == place for body in model.bodies) else "drive.factor"


def _scale_is_free(described: RigModel) -> bool:
    # One body on links that are all fitted, with a given motion and no record of a force: all forces change with its mass, and no
    # motion does.
    imposed, free = described.drive.imposes, described.free
    forces = [(f"links.{link.name}.{name}", getattr(link, name)) for link in described.links for name in ("stiffness", "damping")]
    return (
        imposed is not None
        and len(described.drives) == 1
        and sum(body.name != imposed for body in described.bodies) == 1
        and not any(sensor.force_in for sensor in described.sensors)
        and not any(link.laws for link in described.links)
        and all(value == 0.0 or path in free for path, value in forces)
        and all(f"contacts.{contact.name}.law.friction_force" in free for contact in described.contacts)
    )


def _heavier(model: RigModel, path: str, body: str) -> Iterator[RigModel]:
    # A mass far from its given value, on a link that keeps its frequency and damping ratio: the fit has the right ones of both.
    links = [link for link in model.links if link.a == body]
    for share in FACTORS if path.startswith("bodies.") else ():
        yield model.replace(
            {path: share * model.get(path)}
            | {f"links.{link.name}.{name}": share * getattr(link, name) for link in links for name in ("stiffness", "damping")}
        )
