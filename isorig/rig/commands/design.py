"""How soft the isolation may be for given moves."""

from pathlib import Path

from isorig.rig.choices import Method
from isorig.rig.options import OutputFolder

#: Largest number of points and of draws.
MOST = 100_000


def design(
    plan: Path,
    *,
    output: OutputFolder,
    model: str | None = None,
    parameters: Path | None = None,
    method: Method = "joint",
    points: int = 100,
    draws: int = 100,
    offset: tuple[float, ...] = (0.0, 0.01, 0.02),
    rocking_frequency: float = 30.0,
    seed: int = 0,
) -> None:
    """Find the values of chosen parameters with the smallest transmissibility, ratio or rms within the limits of a rig.

    The plan names the parameters that may vary, with their bounds, and the target. A plan without them has the moves of the wire
    bonder: the result is then the largest stroke over the isolation frequency, and the lowest frequency within a limit.

    Example: rig design plan.toml --model absorber -o design

    Example: rig design moves.toml --parameters parameters/parameters.json -o design

    Parameters
    ----------
    plan
        The plan, a TOML file.
    output
        The folder for design.json, tables and figures, and designed.toml, the description with the best values.
    model
        The rig: a description, the name of one that rig describe lists, or a model.json; by default the wire bonder.
    parameters
        The parameters.json of the present rig, with uncertainties; by default the values are those of the model, for the moves
        of the wire bonder those of the thesis.
    method
        For the moves of the wire bonder: the values of the joint fit, or those by half-power.
    points
        Number of designs before the refinement, and of points in each sweep; for the moves the number of isolation frequencies.
    draws
        Number of parameter sets drawn from the uncertainties.
    offset
        For the moves of the wire bonder: distances of the drive from the motor's centre of gravity to study, m.
    rocking_frequency
        For the moves of the wire bonder: frequency at which the motor rocks on its bearings, Hz.
    seed
        Random seed of the draws.
    """
    from isorig.rig.design.parameters import is_parameter_plan
    from isorig.rig.errors import PlanError

    if not 2 <= points <= MOST or not 0 <= draws <= MOST:
        raise PlanError(f"{points} points and {draws} draws are not possible; give two points or more, and up to {MOST} of each")
    if is_parameter_plan(plan):
        sentences = _parameters(plan, output, model or "wire-bonder", parameters, points=points, draws=draws, seed=seed)
    elif model is not None:
        raise PlanError(
            f"{plan} has no [[vary]] with parameter, low and high, which a design of another rig needs; add it, or omit --model"
        )
    else:
        sentences = _moves(plan, output, parameters, method, points, draws, offset, rocking_frequency, seed)
    print(*sentences, output, sep="\n")


def _parameters(plan: Path, output: Path, model: str, table: Path | None, *, points: int, draws: int, seed: int) -> list[str]:
    from rich.console import Console

    from isorig.rig.design.parameters import designed_parameters, read_parameter_plan, write_parameter_design
    from isorig.rig.files.rigfile import read_rig

    read = read_parameter_plan(plan)
    with Console(stderr=True).status("simulating designs"):
        found = designed_parameters(read, read_rig(model), table, points=points, draws=draws, seed=seed)
        return write_parameter_design(output, found)


def _moves(
    profile: Path, output: Path, parameters: Path | None, method: Method, points: int, draws: int,
    offset: tuple[float, ...], rocking_frequency: float, seed: int,
) -> list[str]:  # fmt: skip
    from isorig.rig.process.terminal import show_table
    from isorig.rig.wire_bonder.design_files import write_design
    from isorig.rig.wire_bonder.design_study import designed, read_design, with_head
    from isorig.rig.wire_bonder.parameters import read_rig_values

    plan = read_design(profile)
    values = with_head(read_rig_values(parameters, method), plan)
    found = designed(plan, values, draws=draws, seed=seed, points=points, offsets=offset, rocking_frequency=rocking_frequency)
    sentences = write_design(output, plan, values, found)
    rows = [(name, _shown(s.lowest), f"{s.std:.2g}", _shown(s.recommended)) for name, s in found.studies.items()]
    title = f"stroke within {1e3 * plan.limit / plan.safety:.3g} mm"
    show_table(title, ("", "lowest, Hz", "std, Hz", "recommended, Hz"), rows)
    return sentences


def _shown(value: float) -> str:
    return f"{value:.3g}" if abs(value) < float("inf") else "none"
