"""The friction simulator: any lumped rig, with a drive that is band-limited between samples."""

from isorig.analysis.simulate.batch import scan
from isorig.analysis.simulate.free_run import Response, record, true_drives
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import Change, Trace, simulate, trace

__all__ = [
    "Change", "Excitation", "Response", "Trace", "record", "scan", "simulate", "trace", "true_drives",
]  # fmt: skip
