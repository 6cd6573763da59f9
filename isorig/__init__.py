"""The public names of the toolkit for notebooks and scripts, from reading a recording to the diagnosis.

    import isorig as iso

The names of `isorig/names.py` are the stable interface; `docs/api.md` states what is guaranteed. They are loaded when the first
of them is used, so `import isorig` is quick. Everything else in `analysis`, `rig` and `drivers` may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from isorig.names import *  # noqa: F403

    __version__: str
else:
    # Hidden from type checkers, for which a module with `__getattr__` has every name.
    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            return version("isorig")
        # The import system asks for subpackages and for names with underscores; both exist without the interface.
        if name.startswith("_") or name in ("analysis", "drivers", "names", "rig"):
            raise AttributeError(f"module 'isorig' has no attribute {name!r}")
        names = import_module("isorig.names")
        if name not in names.__all__:
            raise AttributeError(f"isorig has no {name!r}; it has {', '.join(names.__all__)}")
        return getattr(names, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module("isorig.names").__all__})
