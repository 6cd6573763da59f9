"""The friction simulator: any lumped rig, driven between samples by a band-limited force."""

from analysis.simulate.free_run import Response, record, simulate, true_drive
from analysis.simulate.sampling import Excitation

__all__ = ["Excitation", "Response", "record", "simulate", "true_drive"]
