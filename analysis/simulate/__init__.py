"""The friction simulator: any lumped rig, driven between samples by a band-limited force."""

from analysis.simulate.batch import Batch, scan, simulate_many
from analysis.simulate.free_run import Response, record, simulate, true_drive
from analysis.simulate.sampling import Excitation
from analysis.simulate.trace import Change, Trace, trace

__all__ = [
    "Batch", "Change", "Excitation", "Response", "Trace", "record", "scan", "simulate", "simulate_many", "trace", "true_drive",
]  # fmt: skip
