"""The whole chain, without hardware."""

from pathlib import Path

from isorig.rig.options import OutputFolder


def demo(*, output: OutputFolder = Path("demo-out"), seed: int = 1, investigate: bool = False) -> None:
    """Measure a virtual rig through a real port, then analyse the recording: transfer functions, parameters, isolation, cause.

    The rig has the thesis's parameters, 20 N of friction and a head of 6.5 kg. A simulated instrument on a pseudo-terminal plays
    it faster than real time; everything else is as with a real instrument.

    Example: rig demo -o demo-out

    Parameters
    ----------
    output
        The folder for all results; the recording and the page are campaign.h5 and report.html.
    seed
        Random seed of the sensor noise, and of the hidden effect.
    investigate
        Instead: hide an effect in the rig and search for it with rig investigate, from the first run on.
    """
    if investigate:
        from isorig.rig.next.demo import show

        show(output, seed)
        return
    from isorig.rig.acquire.plan import as_virtual
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.rig_operator import MeasuredRun, Operator
    from isorig.rig.acquire.session import acquire
    from isorig.rig.commands.frf import frf
    from isorig.rig.commands.isolation import isolation
    from isorig.rig.diagnose.many import diagnose_file
    from isorig.rig.files.output import write_text
    from isorig.rig.files.parameter_table import characterize_campaign, write_characterization
    from isorig.rig.files.recording import read
    from isorig.rig.process.terminal import show_table
    from isorig.rig.report.measurement import measurement_page
    from isorig.rig.report.sections import with_unit
    from isorig.rig.virtual.demo import PLAN, Clock, virtual_instrument

    clock = Clock()
    recording = output / "campaign.h5"
    recording.with_name(recording.name + ".partial").unlink(missing_ok=True)

    def took(item: MeasuredRun) -> None:
        coherent = ", ".join(f"{name} {value:.2f}" for name, value in item.verdict.coherence.items())
        clock.tell(
            f"  {item.id}: {item.tally.stored} samples, {item.tally.lost} lost" + (f"; coherence {coherent}" if coherent else "")
        )

    with virtual_instrument(seed) as port:
        clock.tell(f"measuring {PLAN.name} with the instrument at {port}")
        operator = Operator(lock=lambda _: None, watch=lambda _: None, taken=took)
        acquire(as_virtual(read_plan(PLAN)), port, recording, operator)
    clock.tell(f"{recording} written; the following steps use this file only")
    measured = read(recording)
    clock.tell("transfer functions")
    frf(recording, output=output / "frf")
    clock.tell("parameters: all runs fitted at once, friction in the model")
    found = characterize_campaign(measured, lambda _: None)
    write_characterization(output, measured, found)
    clock.tell("isolation ratio, measured and simulated with these parameters")
    isolation(recording, output=output / "isolation", model=output / "model.json")
    clock.tell("the report")
    page = write_text(output / "report.html", measurement_page(measured, found))
    clock.tell("diagnosis of a frictionless simulation")
    outcome = diagnose_file(recording, output / "diagnosis", "linear")
    from isorig.rig.wire_bonder.description import THESIS

    rows = [(name, with_unit(e.value, e.unit, e.std), with_unit(THESIS[name], e.unit)) for name, e in found.table.items()]
    show_table("Parameters compared with the thesis's", ("parameter", "value ± std", "thesis"), rows)
    results = [
        ("held-out error of the simulation with friction", f"{100 * found.error:.2g} %"),
        ("noise alone", found.noise_alone),
        ("held-out error without friction", f"{100 * (outcome.holdout_baseline or 0.0):.3g} %"),
        ("identified cause of that", f"{outcome.causes} at {outcome.locations}" if outcome.causes else "none"),
        ("recording", str(recording)),
        ("tables and figures", f"{output / 'frf'}, {output / 'isolation'}, {output / 'parameters.csv'}"),
        ("report of the measurement", str(page)),
        ("report of the diagnosis", str(output / "diagnosis" / "report.html")),
        ("time", f"{clock.seconds:.0f} s"),
    ]
    show_table("Summary", ("what", "result"), results)
