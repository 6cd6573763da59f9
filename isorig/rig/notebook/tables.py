"""Results as xarray.Dataset and pandas.DataFrame, with coordinates and units; state-space models for scipy and python-control."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Run
from isorig.analysis.isolation.ratio import IsolationRatio
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.simulate.free_run import Response
from isorig.analysis.simulate.state_space import StateSpace
from isorig.analysis.spectra.modal_analysis import ModalModel
from isorig.analysis.spectra.welch import FRF_ROWS, Frf
from isorig.analysis.views import shows
from isorig.rig.errors import RigError
from isorig.rig.frf.transfer import Transfer
from isorig.rig.model.baseline import baseline_model

if TYPE_CHECKING:
    import control
    import pandas as pd
    import xarray
    from scipy.signal import StateSpace as ScipyStateSpace

Column = tuple[Any, str]
"""Values, shape (n,), and their unit."""
Columns = tuple[str, Column, Mapping[str, Column], Mapping[str, Any]]
"""The name of a coordinate with its values, the columns over it by name, and what is known about them."""


shows(Campaign, "rig")(baseline_model)


def needed(name: str) -> ModuleType:
    """An optional package; raises RigError, with how to install it, if it is missing."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise RigError(f"the package {name} is not installed; install it: pip install 'isorig[notebook]'") from None


def _dataset(dimension: str, at: Column, columns: Mapping[str, Column], about: Mapping[str, Any]) -> xarray.Dataset:
    xr = needed("xarray")
    data = {name: (dimension, values, {"units": unit}) for name, (values, unit) in columns.items()}
    found: xarray.Dataset = xr.Dataset(data, coords={dimension: (dimension, at[0], {"units": at[1]})}, attrs=about)
    return found


def _frame(dimension: str, at: Column, columns: Mapping[str, Column], about: Mapping[str, Any]) -> pd.DataFrame:
    import pandas as pd

    frame = pd.DataFrame({name: values for name, (values, _) in columns.items()}, index=pd.Index(at[0], name=dimension))
    units = {dimension: at[1]} | {name: unit for name, (_, unit) in columns.items()}
    frame.attrs.update(about, units=units)
    return frame


def _over_time(rate: float, columns: Mapping[str, Column], about: Mapping[str, Any]) -> Columns:
    n = max((len(values) for values, _ in columns.values()), default=0)
    return "time", (np.arange(n) / rate, "s"), columns, about


def _run(run: Run) -> Columns:
    about = {"run": run.id, "configuration": run.configuration, "gain": run.gain, "excitation": run.excitation}
    return _over_time(run.sample_rate, {name: (channel.read(), channel.unit) for name, channel in run.channels.items()}, about)


def _response(response: Response) -> Columns:
    columns = {name: (values, response.units.get(name, "")) for name, values in response.channels.items()}
    return _over_time(response.sample_rate, columns, {})


def _frf(frf: Frf) -> Columns:
    response, reference = (unit or "?" for unit in frf.units)
    ratio = "1" if response == reference else f"({response})/({reference})"
    units = {"value": ratio, "magnitude_std": ratio, "phase_std": "rad"}
    rows = {name: (values, units.get(name, "1")) for name in FRF_ROWS if (values := getattr(frf, name)) is not None}
    about: dict[str, Any] = {"response": frf.response, "reference": frf.reference, "estimator": frf.estimator}
    if isinstance(frf, Transfer):
        about |= {"configuration": frf.configuration, "gain": frf.gain, "runs": list(frf.runs), "band": list(frf.band)}
    return "frequency", (frf.frequency, "Hz"), rows, about


def _ratio(found: IsolationRatio) -> Columns:
    columns = {"ratio": (found.ratio, "1"), "std": (found.std, "1"), "gain": (found.gain, "1")}
    return "frequency", (found.frequency, "Hz"), columns, {}


def _converts(kind: type, columns_of: Callable[[Any], Columns]) -> None:
    # A result that is columns over time or frequency becomes a dataset or a frame.
    shows(kind, "to_xarray")(lambda result: _dataset(*columns_of(result)))
    shows(kind, "to_pandas")(lambda result: _frame(*columns_of(result)))


for _kind, _columns_of in ((Run, _run), (Response, _response), (Frf, _frf), (IsolationRatio, _ratio)):
    _converts(_kind, _columns_of)


@shows(Campaign, "to_pandas")
def campaign_to_pandas(campaign: Campaign) -> pd.DataFrame:
    """A row for each run."""
    import pandas as pd

    keys = ("configuration", "gain", "excitation", "duration", "sample_rate", "use", "started")
    rows = [[getattr(run, key) for key in keys] for run in campaign.runs]
    frame = pd.DataFrame(rows, columns=list(keys), index=pd.Index([run.id for run in campaign.runs], name="run"))
    frame.attrs = {"units": {"duration": "s", "sample_rate": "Hz"}}
    return frame


@shows(Campaign, "to_xarray")
def campaign_to_xarray(campaign: Campaign) -> Any:
    """An xarray.DataTree with a dataset for each run, because runs may have different lengths and rates."""
    return needed("xarray").DataTree.from_dict({run.id: run.to_xarray() for run in campaign.runs})


@shows(Characterization, "to_pandas")
def parameters_to_pandas(found: Characterization) -> pd.DataFrame:
    """The parameter table, with a column of units."""
    import pandas as pd

    rows = {name: (e.value, e.std, e.unit, e.method, e.note) for name, e in found.table.items()}
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=["value", "std", "unit", "method", "note"])
    frame.index.name = "parameter"
    return frame.astype({"value": float, "std": float})


@shows(Characterization, "to_xarray")
def parameters_to_xarray(found: Characterization) -> xarray.Dataset:
    """A scalar variable for each parameter that has a value, with its standard uncertainty and unit as attributes."""
    data = {
        name: ((), e.value, {"units": e.unit, "std": e.std, "method": e.method})
        for name, e in found.table.items()
        if e.value is not None
    }
    dataset: xarray.Dataset = needed("xarray").Dataset(data)
    return dataset


@shows(ModalModel, "to_pandas")
def modes_to_pandas(found: ModalModel) -> pd.DataFrame:
    """A row for each mode."""
    import pandas as pd

    keys = ("frequency", "frequency_std", "damping", "damping_std", "collinearity")
    frame = pd.DataFrame([{key: getattr(mode, key) for key in keys} for mode in found.modes])
    frame.index = pd.RangeIndex(1, len(found.modes) + 1, name="mode")
    frame.attrs = {"units": {"frequency": "Hz", "frequency_std": "Hz", "damping": "1", "damping_std": "1", "collinearity": "1"}}
    return frame


@shows(ModalModel, "to_xarray")
def modes_to_xarray(found: ModalModel) -> xarray.Dataset:
    """Shapes over response and mode, with frequencies and damping ratios as coordinates."""
    xr = needed("xarray")

    def of_modes(name: str) -> FloatArray:
        return np.array([getattr(mode, name) for mode in found.modes])

    dataset: xarray.Dataset = xr.Dataset(
        {"shape": (("response", "mode"), found.shapes(), {"units": "1"})},
        coords={
            "response": list(found.responses), "mode": np.arange(1, len(found.modes) + 1),
            "frequency": ("mode", of_modes("frequency"), {"units": "Hz"}),
            "damping": ("mode", of_modes("damping"), {"units": "1"}),
        },
    )  # fmt: skip
    return dataset


@shows(StateSpace, "to_scipy")
def to_scipy(system: StateSpace) -> ScipyStateSpace:
    """As scipy.signal.StateSpace."""
    from scipy.signal import StateSpace as Scipy

    return Scipy(system.a, system.b, system.c, system.d)


@shows(StateSpace, "to_control")
def to_control(system: StateSpace) -> control.StateSpace:
    """As control.StateSpace."""
    names = {"states": list(system.states), "inputs": list(system.inputs), "outputs": list(system.outputs)}
    return needed("control").ss(system.a, system.b, system.c, system.d, **names)
