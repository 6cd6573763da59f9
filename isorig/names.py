"""The names of the interface: where each is defined."""

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.errors import AnalysisError
from isorig.analysis.isolation.ratio import isolated_share, isolation_ratio
from isorig.analysis.model.rig_model import RigModel as Rig
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import simulate, trace
from isorig.analysis.spectra.modal_analysis import modal_analysis as modes
from isorig.analysis.spectra.modal_fit import fit_modes
from isorig.analysis.spectra.quality import faults
from isorig.analysis.spectra.welch import estimate
from isorig.rig.errors import RigError
from isorig.rig.exchange.importing import import_campaign
from isorig.rig.files.recording import open_recording, read, write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.frf.transfer import transfer_functions as frf
from isorig.rig.model.prediction import predicted as predict

# What results show and convert to in a notebook is registered by these.
from isorig.rig.notebook import pages, plots, tables  # noqa: F401
from isorig.rig.notebook.answers import characterize, diagnose
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

__all__ = [
    "AnalysisError",
    "Campaign",
    "Channel",
    "Excitation",
    "Rig",
    "RigError",
    "Run",
    "VirtualRun",
    "characterize",
    "diagnose",
    "estimate",
    "faults",
    "fit_modes",
    "frf",
    "import_campaign",
    "isolated_share",
    "isolation_ratio",
    "laws",
    "modes",
    "open_recording",
    "predict",
    "read",
    "read_rig",
    "simulate",
    "trace",
    "virtual_campaign",
    "wire_bonder",
    "write",
]
