"""Output of `rig describe`."""

from __future__ import annotations

from rich.console import Console

from isorig.analysis.equations.coverage import Coverage, best_further_sensor, coverage
from isorig.analysis.errors import AnalysisError
from isorig.analysis.model.parameter_units import physical_parameters, unit_of
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import NaturalMode, natural_modes
from isorig.rig.describe.identifiable import from_usual_runs, sentences, uncertainties
from isorig.rig.describe.tree import drawn
from isorig.rig.errors import PlanError
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.process.terminal import show_table

#: Share of a mode's largest motion below which a body is omitted.
STILL = 0.02
#: Maximum number of characters in a line of the drawing.
WIDEST = 1 << 10


def listed() -> None:
    """Print the descriptions that come with the package."""
    models = {name: read_rig(path).model for name, path in SHIPPED.items()}
    show_table(
        "Descriptions that come with the package",
        ("name", "bodies", "drive", "description"),
        [
            (name, str(len(model.bodies)), f"{model.drive.channel} ({model.drive.quantity})", model.note)
            for name, model in models.items()
        ],
    )
    print("rig describe NAME shows one, rig describe NAME -o my-rig.toml copies it, rig describe --new asks for a new one.")


def shown(model: RigModel, *, sensors: bool) -> None:
    """Print the drawing, the parameters, the modes, and which parameters the sensors determine."""
    print(f"{model.name}{f': {model.note}' if model.note else ''}\n")
    # Without line breaks, so that no number is truncated.
    wide = Console(width=WIDEST)
    with wide.capture() as drawing:
        wide.print(drawn(model))
    print("\n".join(line.rstrip() for line in drawing.get().splitlines()))
    print("◄ drive   ● sensor   ⌇ spring and damper   ≈ friction   ? fitted; all other values are treated as known\n")
    free = bool(model.free)
    paths = model.free or tuple(path for path in physical_parameters(model) if model.get(path) != 0.0)
    known: dict[str, str] = {}
    said: list[str] = []
    if sensors:
        try:
            found = from_usual_runs(model, paths)
            known, said = uncertainties(found), sentences(found, free)
        except (AnalysisError, PlanError) as error:
            said = [f"Which parameters the sensors determine is not available: {error}."]
    title = "Fitted" if free else "No parameter is marked as free, so none would be fitted; all parameters"
    columns = ("parameter", "value", "unit", *(("uncertainty",) if known else ()))
    show_table(
        title,
        columns,
        [(path, f"{model.get(path):.6g}", unit_of(path, model), *((known[path],) if known else ())) for path in paths],
    )
    if known:
        print("(uncertainty: relative standard uncertainty from a usual run with noise of 1 % of the rms on every channel)")
    for sentence in said:
        print(sentence)
    print()
    show_coverage(model)
    show_modes(model)


def show_coverage(model: RigModel) -> None:
    """Print the equations of motion that the sensors support, and the places that they cannot tell apart."""
    found = coverage(model)
    if not found.equations:
        print("The sensors support no equation of motion, so faults show in simulations only.\n")
        return
    show_table(
        "Equations of motion that the records must satisfy; a fault breaks those that contain it",
        ("equation", "springs and contacts", "channels"),
        [(name, ", ".join(places), ", ".join(channels)) for name, (places, channels) in found.equations.items()],
    )
    if found.unseen:
        print(f"In no equation, so a fault there shows in simulations only: {', '.join(found.unseen)}.")
    for group in found.alike:
        print(f"In the same equations, so only their different motions separate faults: {', '.join(group)}.")
    further = best_further_sensor(model)
    if further is not None:
        body, better = further
        print(f"One more sensor helps most at {body}: {_improved(found, better)}.")
    print()


def _improved(found: Coverage, better: Coverage) -> str:
    seen = [name for name in found.unseen if name not in better.unseen]
    if seen:
        return f"then {', '.join(seen)} {'is' if len(seen) == 1 else 'are'} in an equation"
    apart = {name for group in found.alike for name in group} - {name for group in better.alike for name in group}
    return f"then {', '.join(sorted(apart))} {'has' if len(apart) == 1 else 'have'} equations of their own"


def show_modes(model: RigModel) -> None:
    """Print the modes of every configuration."""
    several = len(model.configurations) > 1
    found = [
        (*([name] if several else []), f"{mode.frequency:.4g}", f"{mode.damping:.3g}", _shape(model, mode))
        for name in model.configurations
        for mode in natural_modes(model, name)
    ]
    if found:
        columns = ("Hz", "damping ratio", "shape")
        show_table("Modes of the springs and dampers", ("configuration", *columns) if several else columns, found)


def _shape(model: RigModel, mode: NaturalMode) -> str:
    parts = zip(model.bodies, mode.shape.tolist(), strict=True)
    return ", ".join(f"{body.name} {part:+.2f}" for body, part in parts if abs(part) > STILL)
