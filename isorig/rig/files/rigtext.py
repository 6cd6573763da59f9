"""Text of a rig's description in TOML."""

from __future__ import annotations

from collections.abc import Mapping

from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.tomlfile import comments, key_text, plain, table_text, value_text

#: Lists with one entry per line.
LISTS = ("bodies", "links", "contacts", "more_drives", "sensors")
#: Tables after the configurations, at the end of the file.
HEADED = ("limits", "usual")


def description_text(model: RigModel, notes: Mapping[str, str] | None = None) -> str:
    """The description of a rig, formatted for reading and editing; fields with their default value are omitted.

    Parameters
    ----------
    model
        The rig.
    notes
        Comments above keys of the top level, by key; the comment under "" is at the start of the file.
    """
    tree, said = plain(model), notes or {}
    lines = comments(said.get("", ""))
    for key in ("name", "note", "free_free"):
        if key in tree:
            lines.append(f"{key} = {value_text(tree[key])}")
    for key in ("free", *LISTS):
        if tree.get(key):
            lines += ["", *comments(said.get(key, "")), f"{key} = ["]
            lines += [*(f"  {value_text(part)}," for part in tree[key]), "]"]
        if key == "contacts":
            lines += ["", *comments(said.get("drive", "")), f"drive = {value_text(tree['drive'])}"]
    for k, (name, setup) in enumerate(tree.get("configurations", {}).items()):
        above = comments(said.get("configurations", "")) if k == 0 else []
        lines += ["", *above, *table_text(f"configurations.{key_text(name)}", setup)[:-1]]
    for key in HEADED:
        if key in tree:
            lines += ["", *comments(said.get(key, "")), *table_text(key, tree[key])[:-1]]
    return "\n".join(lines) + "\n"
