"""The friction simulator: any lumped rig, driven between samples by a band-limited force."""

from analysis.simulate.batch import Batch, simulate_many
from analysis.simulate.free_run import Response, record, simulate, true_drive
from analysis.simulate.sampling import Excitation

__all__ = ["Batch", "Excitation", "Response", "record", "simulate", "simulate_many", "true_drive"]
