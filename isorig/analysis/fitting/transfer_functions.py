"""Starting values from the logarithms of the transfer functions: a fit without simulation that converges from afar.

The error of a waveform has a minimum wherever one resonance of the model meets another one of the rig, and a lightly damped
resonance that is a few per cent off counts as much as one that is missing. The logarithm of a transfer function weighs all
frequencies alike, so that what lies between the resonances leads to them (Guillaume and others, Robust Parametric Transfer
Function Estimation Using Complex Logarithmic Frequency Response Data, IEEE Trans. Automatic Control 40, 1995).
"""

from collections.abc import Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.linear_spectra import LinearRig, Spectrum, given_parameters
from isorig.analysis.fitting.solve import Free, at_coordinates, coordinates_of
from isorig.analysis.model.rig_model import RigModel

#: Groups of frequency bins of each run. Chosen: resonances with a damping ratio of 0.3 % span two of them in two decades.
BINS = 1500
#: Relative error of a transfer function beyond which it counts less than with its square. Chosen: resonances that a description
#: lacks, and amplitudes that bend those that it has, are errors of this size and more in few frequency bins.
LARGE = 0.3
#: Most evaluations, each with its derivatives. Chosen: from values up to a quarter off, structures took 15 to 52.
EVALUATIONS = 60
#: Parameters on which the transfer functions of a linear rig depend.
OF_LINEAR = (".mass", ".stiffness", ".damping", ".factor", ".gain")
#: Share of a parameter's effect that the free ones do not have, below which the transfer functions do not show it.
UNSEEN = 1e-6
#: Finite difference of a search coordinate for one linear step.
STEP = 1e-5


def fitted_to_transfer_functions(model: RigModel, free: Sequence[Free], spectra: Sequence[Spectrum]) -> RigModel | None:
    """The rig with parameters fitted to the transfer functions of all driven runs.

    Parameters
    ----------
    model, free
        The rig with starting values, and what is fitted of it.
    spectra
        The spectra of the runs in `BINS` groups (`isorig.analysis.fitting.linear_spectra.spectra_of`).

    Returns
    -------
    RigModel | None
        None without a driven run, if the rig is not linear, or if its transfer functions do not depend on a parameter.
    """
    if not spectra or not free or model.contacts or any(link.laws for link in model.links):
        return None
    if not all(each.path.endswith(OF_LINEAR) for each in free):
        return None
    from scipy.optimize import least_squares

    def errors(coordinates: FloatArray) -> FloatArray:
        return _errors(at_coordinates(model, free, coordinates), spectra)

    try:
        found = least_squares(
            errors, coordinates_of(model, free), loss="soft_l1", f_scale=LARGE, x_scale=0.1, max_nfev=EVALUATIONS
        )
        return at_coordinates(model, free, found.x)
    except ModelError:  # values that physics excludes
        return None


def steps_towards(
    model: RigModel, free: Sequence[Free], others: Sequence[Free], spectra: Sequence[Spectrum]
) -> FloatArray:  # fmt: skip
    """Share of the squared errors that one linear step of each further parameter, with all free ones, removes, shape (others,).

    Parameters
    ----------
    model, free
        The rig fitted to the transfer functions, and what was fitted of it.
    others
        Further parameters.
    spectra
        The spectra of the runs.
    """
    here = _errors(model, spectra)
    weight = (1.0 + (here / LARGE) ** 2) ** -0.25  # the root of that of a large error

    def slope(each: Free) -> FloatArray:
        moved = at_coordinates(model, [each], coordinates_of(model, [each]) + STEP)
        return np.asarray(weight * (_errors(moved, spectra) - here) / STEP)

    known = np.linalg.qr(np.stack([slope(each) for each in free], axis=1))[0]
    rest, found = weight * here, []
    for own in map(slope, others):
        beyond = own - known @ (known.T @ own)
        size = float(beyond @ beyond)
        found.append(float(beyond @ rest) ** 2 / size if size > UNSEEN * float(own @ own) else 0.0)
    return np.array(found) / float(rest @ rest)


def _errors(model: RigModel, spectra: Sequence[Spectrum]) -> FloatArray:
    # Logarithms of predicted over measured cross spectra of drives and responses, less where noise hides the response.
    found, rigs = [], {run.configuration: LinearRig(model, run.configuration) for run in (each.run for each in spectra)}
    values = given_parameters(model)
    for each in spectra:
        response = rigs[each.run.configuration].responses(each.omega, values)[:, :, 0]
        predicted = np.einsum("deg,reg->drg", each.drives, response)
        signal = np.maximum(each.power - each.noise, 0.0)
        heard = np.sqrt(signal / np.maximum(signal + each.noise / LARGE**2, 1e-300))
        # A sensor that the drive does not reach has no ratio.
        both = (heard > 0.0) & (predicted != 0.0) & (each.across != 0.0) & np.isfinite(predicted)
        ratio = np.where(both, predicted, 1.0) / np.where(both, each.across, 1.0)
        found.append((heard * np.log(ratio)).ravel())
    logarithms = np.concatenate(found)
    return np.concatenate([logarithms.real, logarithms.imag])
