"""The formats that can be imported, one file each: every file of this package is searched."""

from importlib import import_module
from pkgutil import iter_modules

from isorig.rig.exchange.table import Format

#: By file name extension.
FORMATS = {
    extension: value
    for module in iter_modules(__path__)
    for value in vars(import_module(f"{__name__}.{module.name}")).values()
    if isinstance(value, Format)
    for extension in value.extensions
}
