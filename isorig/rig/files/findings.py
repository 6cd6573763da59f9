"""findings.json: the answer of a diagnosis for other programs, as one type that writes and reads it."""

from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from isorig.analysis.diagnose.causes.base import Kind
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import write_json

T = TypeVar("T", bound=msgspec.Struct)
NAME = "findings.json"
AGAIN = "diagnose the recording again with this version of the program"

#: A computed number; null in the file where it is not available.
Number = float | None
Interval = tuple[Number, Number]
DiagnosisVerdict = Literal["adequate", "explained", "partly explained", "unexplained"]


class Value(msgspec.Struct, frozen=True, kw_only=True):
    """A value with its standard uncertainty and unit."""

    value: Number
    std: Number
    unit: str


class HeldValue(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of a law that no fit changes, with its unit."""

    value: Number
    unit: str


class Share(msgspec.Struct, frozen=True, kw_only=True):
    """A share with its 95 % interval."""

    value: Number
    low: Number
    high: Number


class DoubtfulValue(msgspec.Struct, frozen=True, kw_only=True):
    """An implausible unit, channel or given value, to be checked first."""

    parameter: str
    kind: Literal["drafted", "swapped", "place", "clock", "reversed", "sign", "derivative", "unit", "decade", "limit"]
    ratio: Number
    text: str


class FittedBaseline(msgspec.Struct, frozen=True, kw_only=True):
    """The baseline's name ("description" for a rig with its own) and fitted parameters by path."""

    name: str
    parameters: dict[str, Value]


class FittedExtension(msgspec.Struct, frozen=True, kw_only=True):
    """The fitted parameters of the extended model by path."""

    parameters: dict[str, Value]


class Misfit(msgspec.Struct, frozen=True, kw_only=True):
    """A discrepancy between simulation and measurement: its place, its size and that of noise alone as shares of the signal."""

    channel: str
    configuration: str
    gain: float
    run: str
    band_hz: tuple[float, float]
    what: Literal["frf", "time", "coherence", "ratio"]
    size: Number
    noise: Number
    text: str


class Adequacy(msgspec.Struct, frozen=True, kw_only=True):
    """The baseline's largest ratio of error to allowed error, its threshold, and that of simulated data if it was needed."""

    worst: Number
    threshold: Number
    baseline_rig: Number
    how: str


class ClosestForm(msgspec.Struct, frozen=True, kw_only=True):
    """The catalogued form that came closest to a free shape, and its share of the excess error."""

    cause: str
    share: Number


class FreeShape(msgspec.Struct, frozen=True, kw_only=True):
    """A curve chosen by the data: (position, value, std), ascending, and the range that the runs cover."""

    over: Literal["deflection", "speed", "position", "time"]
    unit: str
    value_unit: str
    points: list[tuple[float, Number, Number]]
    reached: tuple[float, float]


class OtherCause(msgspec.Struct, frozen=True, kw_only=True):
    """A fitted rival of a named cause."""

    cause: str
    location: str
    holdout_error: Number


class NamedCause(msgspec.Struct, frozen=True, kw_only=True):
    """A step of the answer: a place with a kind, and a form if one was earned; `curve` only where a free shape was fitted."""

    cause: str
    location: str
    kind: Kind
    form: str | None
    closest_form: ClosestForm | None
    level: Literal["form", "kind"]
    share: Share
    curve: FreeShape | msgspec.UnsetType = msgspec.UNSET
    parameters: dict[str, Value]
    held: dict[str, HeldValue] = {}
    confidence: Number
    rivals: list[OtherCause]
    evidence: list[str]
    holdout_error_before: Number
    holdout_error_after: Number


class TriedCause(msgspec.Struct, frozen=True, kw_only=True):
    """A considered cause with its status; error and share are null if it was not fitted."""

    cause: str
    kind: Kind
    location: str
    holdout_error: Number
    share: Number
    standing: Literal["established", "main contributor", "one of several", "not confirmed", "ruled out", "not tested"]
    why: str


class ErrorBudget(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of a model's held-out error power by nature, which sum to 1."""

    noise: Share
    disturbance: Share
    linear: Share
    amplitude: Share
    time: Share
    unassigned: Share
    by_channel: dict[str, dict[str, Number]]
    by_configuration: dict[str, dict[str, Number]]
    how: str


class Budgets(msgspec.Struct, frozen=True, kw_only=True):
    """The error budgets of both models."""

    baseline: ErrorBudget
    extended: ErrorBudget


class CauseAt(msgspec.Struct, frozen=True, kw_only=True):
    """A cause at a place."""

    cause: str
    location: str


class KindAt(msgspec.Struct, frozen=True, kw_only=True):
    """A kind of cause at a place."""

    kind: Kind
    location: str


class HeldOut(msgspec.Struct, frozen=True, kw_only=True):
    """Held-out errors of both models and of noise alone, as shares of the signal, with 95 % intervals."""

    baseline: float
    extended: float
    noise_floor: float
    baseline_interval: Interval
    extended_interval: Interval
    removed: Number
    removed_interval: Interval
    interval: str
    how: str


class RequiredForce(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of the force that the recorded motion requires at the last step's place which the model without that step and the
    extended model leave on held-out samples."""

    baseline: float
    extended: float
    follows: bool = False  #: Whether a simulation follows the motion nonetheless, and noise hides the cause from it.


class Findings(msgspec.Struct, frozen=True, kw_only=True, tag_field="format", tag="rig-findings"):
    """The answer of a diagnosis."""

    format_version: Literal[2] = 2  #: Version of the file format.
    origin: dict[str, str]  #: The baseline's name, the recording's name and hash, and this program's version, as far as known.
    doubts: list[DoubtfulValue]  #: Implausible units, channels and given values, to be checked first.
    verdict: DiagnosisVerdict  #: In which of four ways the diagnosis ended.
    #: Fitted parameters of both models.
    baseline: FittedBaseline
    extended: FittedExtension
    discrepancies: list[Misfit]  #: What the baseline gets wrong.
    evidence: list[str]  #: Signs in the records, before any cause is fitted, as sentences.
    remarks: list[str]  #: What an unexplained error consists of, and what the recording lacks, as sentences.
    adequacy: Adequacy  #: How the baseline was judged.
    tolerance: float  #: Error, as a share of the signal, that counts as adequate.
    cut_short: bool  #: Whether the time limit ended the search for causes.
    #: The kind of cause and the place to which the equations of motion clearly point, if no simulation confirms any cause: none
    #: follows the records, or the time limit ended the search.
    pointed: KindAt | None = None
    #: What confirms the first step if no simulation can follow the motion; None if simulations do.
    required_force: RequiredForce | None = None
    #: Small errors of several channels with which the model explains all that follows the drive, each as a phrase if it is larger
    #: than a calibration tells; None where these do not count.
    chain_errors: list[str] | None = None
    time_limit_s: float | None  #: The given time limit, s; None for none.
    driven: bool = True  #: Whether a drive is recorded in any run; otherwise the rig was only released.
    steps: list[NamedCause]  #: The named causes, largest first.
    candidates: list[TriedCause]  #: All considered causes.
    budget: Budgets  #: Composition of the errors.
    indistinguishable: list[list[CauseAt]]  #: Sets of causes that these runs cannot distinguish, each with the named one first.
    holdout: HeldOut  #: Held-out errors.


def as_read(findings: Findings) -> Findings:
    """The findings as a reader of the file gets them: a number that is not finite becomes None. Raises msgspec.ValidationError if
    a value is not one that the file format allows."""
    return msgspec.json.decode(msgspec.json.encode(findings), type=Findings)


def write_findings(folder: Path, findings: Findings) -> Path:
    """Write findings.json into a folder; returns its path."""
    return write_json(folder / NAME, findings)


def read_findings(folder: Path) -> Findings:
    """Read the findings.json of a folder. Raises PlanError if the folder contains no findings, damaged ones, or those of another
    version."""
    return read_answer(folder, NAME, Findings)


def read_answer(folder: Path, name: str, kind: type[T]) -> T:
    """Read a file of a diagnosis as a type. Raises PlanError if the folder does not contain it, or it is damaged or of another
    version."""
    path = folder / name
    try:
        return msgspec.json.decode(content_of(path), type=kind)
    except FileNotFoundError:
        if name != NAME and (folder / NAME).is_file():
            raise PlanError(f"{folder} has {NAME} but no {name}; {AGAIN}") from None
        raise PlanError(f"{folder} contains no diagnosis; give the folder that rig diagnose -o wrote") from None
    except NotADirectoryError:
        raise PlanError(f"{folder} is not a folder; give the folder that rig diagnose -o wrote") from None
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give the folder that rig diagnose -o wrote") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise PlanError(f"{path} is damaged or of another version ({error}); {AGAIN}") from None
