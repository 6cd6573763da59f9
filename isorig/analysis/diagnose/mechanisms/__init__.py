"""The catalogue of causes: every class of this package's files that has a cause, a kind and candidates (`base.Mechanism`)."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from isorig.analysis.diagnose.mechanisms.base import Mechanism

_FILES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]

CATALOGUE: tuple[Mechanism, ...] = tuple(
    value()
    for file in _FILES
    for value in vars(file).values()
    if isinstance(value, type) and value.__module__ == file.__name__ and "cause" in vars(value) and "kind" in vars(value)
)
