"""Draws and checks a rig's description, or writes one."""

from isorig.rig.options import Flag, Output


def describe(rig: str | None = None, *, output: Output | None = None, new: Flag = False, sensors: bool = True) -> None:
    """Show a rig's description: bodies, springs, contacts, drive and sensors, what is known, and what its sensors determine.

    Without a rig, list the descriptions that come with the package. With --new, ask for a rig and write its description.

    Example: rig describe two-carts

    Example: rig describe my-rig.toml -o my-rig.svg

    Example: rig describe --new -o my-rig.toml

    Parameters
    ----------
    rig
        A description in .toml, the name of one that comes with the package, or a model.json.
    output
        Where to write: a picture (.svg), or the description itself (.toml) to edit.
    new
        Ask a few questions and write the description.
    sensors
        Whether to simulate a usual run and report which parameters the sensors cannot distinguish.
    """
    from isorig.rig.describe.show import listed, shown
    from isorig.rig.errors import PlanError
    from isorig.rig.files.output import write_text
    from isorig.rig.files.rigfile import description_text, read_rig
    from isorig.rig.report.sketch import picture

    if output is not None and output.suffix.lower() not in (".svg", ".toml"):
        raise PlanError(f"{output} ends in {output.suffix or 'nothing'}; give .svg for a picture or .toml for the description")
    if new:
        from isorig.rig.describe.questions import asked

        if rig is not None or output is None or output.suffix.lower() != ".toml":
            raise PlanError("--new asks questions about a rig and writes its description; call rig describe --new -o FILE.toml")
        if output.exists():
            raise PlanError(f"{output} exists; give another name with -o, or remove that file first")
        model = asked(input)
        write_text(
            output, description_text(model, {"": "Written by rig describe --new; every key is explained in docs/describe.md."})
        )
        shown(model, sensors=sensors)
        print(output)
        return
    if rig is None:
        listed()
        return
    given = read_rig(rig)
    if output is not None and output.suffix.lower() == ".toml":
        write_text(output, given.description or description_text(given.model))
    elif output is not None:
        write_text(output, picture(given.model))
    shown(given.model, sensors=sensors)
    if output is not None:
        print(output)
