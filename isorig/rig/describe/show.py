"""Output of `rig describe`: the drawing of a rig in the terminal, its parameters, modes, and what its sensors determine."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.tree import Tree

from isorig.analysis.campaign import SI_UNIT, Campaign
from isorig.analysis.equations.coverage import Coverage, best_further_sensor, coverage
from isorig.analysis.errors import AnalysisError
from isorig.analysis.fitting.identifiability import Identifiability, identifiability
from isorig.analysis.model.parameter_units import factor_unit, physical_parameters, unit_of
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.wording import words
from isorig.rig.errors import PlanError
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.files.tomlfile import plain
from isorig.rig.model.prediction import predicted
from isorig.rig.process.terminal import show_table
from isorig.rig.virtual.simulated_recording import synthetic_drive, usual_run

#: Share of a mode's largest motion below which a body is omitted.
STILL = 0.02
#: Maximum length of a simulated run, s.
LONGEST = 8.0
#: Maximum number of characters in a line of the drawing.
WIDEST = 1 << 10


def listed() -> None:
    """Print the descriptions that come with the package."""
    models = {name: read_rig(path).model for name, path in SHIPPED.items()}
    rows = [
        (name, str(len(model.bodies)), f"{model.drive.channel} ({model.drive.quantity})", model.note)
        for name, model in models.items()
    ]
    show_table("Descriptions that come with the package", ("name", "bodies", "drive", "description"), rows)
    print("rig describe NAME shows one, rig describe NAME -o my-rig.toml copies it, rig describe --new asks for a new one.")


def shown(model: RigModel, *, sensors: bool) -> None:
    """Print the drawing, the parameters, the modes, and which parameters the sensors determine."""
    print(f"{model.name}{f': {model.note}' if model.note else ''}\n")
    # Without line breaks, so that no number is truncated.
    wide = Console(width=WIDEST)
    with wide.capture() as drawing:
        wide.print(_tree(model))
    print("\n".join(line.rstrip() for line in drawing.get().splitlines()))
    print("◄ drive   ● sensor   ⌇ spring and damper   ≈ friction   ? fitted; all other values are treated as known\n")
    free = bool(model.free)
    paths = model.free or tuple(path for path in physical_parameters(model) if model.get(path) != 0.0)
    known: dict[str, str] = {}
    said: list[str] = []
    if sensors:
        try:
            found = _from_usual_runs(model, paths)
            said = _sentences(found, free)
            known = {
                path: "not identifiable" if not np.isfinite(std) else f"{100.0 * std:{'.0f' if std >= 0.0995 else '.2g'}} %"
                for path, std in zip(found.paths, found.std, strict=True)
            }
        except (AnalysisError, PlanError) as error:
            said = [f"Which parameters the sensors determine is not available: {error}."]
    title = "Fitted" if free else "No parameter is marked as free, so none would be fitted; all parameters"
    columns = ("parameter", "value", "unit", *(("uncertainty",) if known else ()))
    rows = [(path, f"{model.get(path):.6g}", unit_of(path, model), *((known[path],) if known else ())) for path in paths]
    show_table(title, columns, rows)
    if known:
        print("(uncertainty: relative standard uncertainty from a usual run with noise of 1 % of the rms on every channel)")
    print(*said, "", sep="\n")
    show_coverage(model)
    show_modes(model)


def _tree(model: RigModel) -> Tree:
    # The rig from the ground: springs, dampers and contacts with their values, bodies with drive and sensors. A joint between two
    # bodies that are already in the tree is shown at one of them, with an arrow to the other.
    tree = Tree("ground (fixed)", highlight=False)
    places = {GROUND: tree}
    left = [*model.joints]
    waiting = [body.name for body in model.bodies]
    while left:
        joint = next((one for one in left if one.a in places or one.b in places), None)
        if joint is None:  # a body that no joint connects to the ground
            name = next(name for name in waiting if name not in places)
            places[name] = Tree(_body(model, name), highlight=False)
            tree.add(places[name])
            continue
        left.remove(joint)
        near, far = (joint.b, joint.a) if joint.b in places else (joint.a, joint.b)
        branch = places[near].add(_joint(model, joint))
        if far in places:
            branch.label = f"{branch.label} → {far}"
        else:
            places[far] = branch.add(_body(model, far))
    for name in waiting:
        if name not in places:
            tree.add(_body(model, name))
    for sensor in model.sensors:
        if sensor.force_in is not None:
            tree.add(f"● {sensor.channel}: {sensor.quantity} in {sensor.force_in}, {SI_UNIT[sensor.quantity]}")
    return tree


def _body(model: RigModel, name: str) -> str:
    lines = [f"[{name}] {_number(model, f'bodies.{name}.mass')}"]
    for drive in model.drives:
        quantity = f"{drive.channel}: {words(drive.quantity)}, {SI_UNIT[drive.quantity]}"
        if drive.imposes == name:
            lines.append(f"  ◄ motion imposed by {quantity}")
        if name in drive.pushes:
            unit = factor_unit(model, drive)
            free = " ?" if drive is model.drive and "drive.factor" in model.free else ""
            factor = f"{drive.factor:.4g}{'' if unit == '1' else f' {unit}'}{free}"
            parts = [part for part in (f"{drive.pushes[name]:g}", factor) if part != "1"]
            lines.append(f"  ◄ pushed by {' × '.join([*parts, quantity])}")
    for sensor in model.sensors:
        if sensor.body == name:
            base = "" if sensor.relative_to == GROUND else f" relative to {sensor.relative_to}"
            lines.append(f"  ● {sensor.channel}: {words(sensor.quantity)}{base}, {SI_UNIT[sensor.quantity]}")
    return "\n".join(lines).replace("[", r"\[")


def _joint(model: RigModel, joint: Link | Contact) -> str:
    if isinstance(joint, Contact):
        said = [_law(model, joint.law, f"contacts.{joint.name}.law")]
        sign = "≈"
    else:
        keys = {"stiffness": "spring", "damping": "damper"}
        said = [f"{word} {_number(model, f'links.{joint.name}.{key}')}" for key, word in keys.items() if getattr(joint, key)]
        said += [_law(model, law, f"links.{joint.name}.laws.{k}") for k, law in enumerate(joint.laws)]
        sign = "⌇"
    arms = [f"{factor:+g} × {name}" for name, factor in joint.arms.items()]
    acts = f" (on {joint.a} − {joint.b} {' '.join(arms)})" if arms else ""
    return f"{sign} {joint.name}: {', '.join(said) or 'nothing'}{acts}".replace("[", r"\[")


def _law(model: RigModel, law: object, path: str) -> str:
    tree = plain(law)
    name = str(tree.pop("law"))
    values = [
        f"{words(key)} {_number(model, f'{path}.{key}')}" if isinstance(value, float) else key for key, value in tree.items()
    ]
    return f"{words(name)} ({', '.join(values)})"


def _number(model: RigModel, path: str) -> str:
    unit = unit_of(path, model)
    return f"{model.get(path):.4g}{'' if unit == '1' else f' {unit}'}{' ?' if path in model.free else ''}"


def _from_usual_runs(model: RigModel, paths: Sequence[str]) -> Identifiability:
    # From one run in each configuration, each at most `LONGEST` seconds.
    runs = []
    for k, name in enumerate(model.configurations):
        plan = usual_run(model, name)
        plan = replace(plan, seconds=min(plan.seconds, LONGEST), seed=k + 1)
        whole = predicted(model, synthetic_drive(model, plan))
        runs += [replace(run, id=name, started=None) for run in whole.runs]
    return identifiability(model, Campaign(runs=tuple(runs), source="a usual run"), paths)


def _sentences(found: Identifiability, free: bool) -> list[str]:
    # `free` states whether the parameters are those marked as free.
    said = []
    remedy = "Remove at least one of them from free and give its value, or add a sensor or a configuration." if free else ""
    for group in found.indistinguishable:
        said.append(
            f"The sensors cannot distinguish {', '.join(group)}: a joint change has no effect on any sensor. {remedy}".strip()
        )
    if found.without_effect:
        remedy = "Remove them from free, or give in usual a drive that excites them." if free else ""
        said.append(f"No effect on any sensor in a usual run: {', '.join(found.without_effect)}. {remedy}".strip())
    if found.correlated:
        said.append(f"Poorly determined, strongly correlated: {', '.join(found.correlated)}. Use longer runs or more sensors.")
    return said or ["The sensors determine all of them."]


def show_coverage(model: RigModel) -> None:
    """Print the equations of motion that the sensors support, and the places that they cannot tell apart."""
    found = coverage(model)
    if not found.equations:
        print("The sensors support no equation of motion, so faults show in simulations only.\n")
        return
    title = "Equations of motion that the records must satisfy; a fault breaks those that contain it"
    rows = [(name, ", ".join(places), ", ".join(channels)) for name, (places, channels) in found.equations.items()]
    show_table(title, ("equation", "springs and contacts", "channels"), rows)
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
    found = []
    for name in model.configurations:
        for mode in natural_modes(model, name):
            parts = zip(model.bodies, mode.shape.tolist(), strict=True)
            shape = ", ".join(f"{body.name} {part:+.2f}" for body, part in parts if abs(part) > STILL)
            found.append((*([name] if several else []), f"{mode.frequency:.4g}", f"{mode.damping:.3g}", shape))
    if found:
        columns = ("Hz", "damping ratio", "shape")
        show_table("Modes of the springs and dampers", ("configuration", *columns) if several else columns, found)
