"""The look at a run right after it was taken, where the run is longer than what is held in memory of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.spectra.overload import LONGEST
from isorig.analysis.spectra.periodic import Detection
from isorig.rig.acquire import run_check
from isorig.rig.acquire.incoherence import Incoherence
from isorig.rig.acquire.pace import ClockDrift
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import _distortion, check_run, incoherences, least_sliding
from isorig.rig.wire_bonder.description import wire_bonder


class Counted:
    """Samples that tell how many of them were asked for at once."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._values, self.shape, self.longest = values, values.shape, 0

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        part = self._values[key]
        self.longest = max(self.longest, len(part))
        return part


def test_a_long_run_is_checked_in_parts() -> None:
    generator, n = np.random.default_rng(1), 2 * LONGEST + 12345
    head = generator.normal(3.0, 1.0, n)
    # What each part differs by from the next counts, too.
    drift = np.repeat([0.0, 5.0, -2.0], LONGEST)[:n]
    values = {"head": head, "motor": head + drift, "table": head + drift + generator.normal(0.0, 0.1, n)}
    values["heatblock"] = 1e-5 * head
    values["gain"] = np.where(np.arange(n) == LONGEST + 7, 69.0, 70.0)
    values["motor"][[3, LONGEST + 4, n - 1]] = 20.0
    samples = {name: Counted(each) for name, each in values.items()}
    run = Run(
        id="a", configuration="unlocked", sample_rate=51200.0, gain=70.0, excitation="random", band=(10.0, 5000.0),
        channels={
            name: Channel(name=name, samples=each, full_scale=20.0 if name == "motor" else None)
            if name != "gain"
            else Channel(name=name, samples=each, quantity="gain", unit="1")
            for name, each in samples.items()
        },
    )  # fmt: skip
    found = Recovered(
        id="a", finished=True, begun=True, run=run, stored=n, lost=0, planned=n, overloads=0, planned_gain=70.0, drift=None
    )
    verdict = check_run(found, rig=wire_bonder())
    assert verdict.sliding == pytest.approx((values["motor"] - values["table"]).std() / values["motor"].std(), rel=1e-9)
    told = " ".join(verdict.advice)
    assert "motor clipped 3 times" in told
    assert f"heatblock hardly moves ({values['heatblock'].std():.2g} m/s^2 rms)" in told
    assert "The gain changed from 69 to 70 during the run" in told
    assert max(each.longest for each in samples.values()) <= LONGEST


def recovered(values: dict[str, NDArray[Any]], *, gain: float = 7.0, **more: Any) -> Recovered:
    """A complete run of the wire bonder, whose records are given."""
    n = len(values["head"])
    run = Run(
        id="a", configuration="unlocked", sample_rate=1024.0, gain=gain, excitation="random", band=(1.0, 400.0),
        channels={name: Channel(name=name, samples=each, quantity="gain" if name == "gain" else "acceleration")
                  for name, each in values.items()},
    )  # fmt: skip
    found = Recovered(
        id="a", finished=True, begun=True, run=run, stored=n, lost=0, planned=n, overloads=0, planned_gain=7.0, drift=None
    )
    return replace(found, **more)


def sound() -> dict[str, NDArray[Any]]:
    """Records in which nothing is wrong: bodies that move with the head, each in its own way."""
    head, other = np.random.default_rng(2).normal(size=(2, 32768))
    return {"head": head, "motor": head + other, "table": head, "heatblock": head}


def told(found: Recovered) -> tuple[bool, str]:
    """Whether the run is good, and the advice."""
    verdict = check_run(found, rig=wire_bonder())
    return verdict.good, " ".join(verdict.advice)


def test_a_sound_run_is_good_and_one_without_samples_is_not() -> None:
    assert told(recovered(sound())) == (True, "")
    good, advice = told(recovered(sound(), run=None))
    assert not good
    assert advice.startswith("No sample arrived")


@pytest.mark.parametrize(
    ("more", "advice"),
    [
        ({"lost": 1}, "1 samples were lost in transmission"),
        ({"finished": False, "stored": 10, "lost": 5, "planned": 30}, "It ended at 15 of 30 samples"),
        ({"overloads": 2}, "The instrument reported 2 overloads"),
        ({"drift": ClockDrift(ppm=2500.0, std=10.0)}, "Its clock deviates from the host's by +0.25"),
    ],
)
def test_what_went_wrong_on_the_way_makes_a_run_bad(more: dict[str, Any], advice: str) -> None:
    good, said = told(recovered(sound(), **more))
    assert not good
    assert advice in said


@pytest.mark.parametrize(("share", "dead"), [(0.9e-4, True), (1.1e-4, False)])
def test_a_channel_below_a_ten_thousandth_of_the_strongest_is_dead(share: float, dead: bool) -> None:
    values = sound()
    values["heatblock"] = share * values["motor"].std() / values["head"].std() * values["head"]
    good, advice = told(recovered(values))
    assert ("heatblock hardly moves" in advice) is dead
    assert good is not dead


@pytest.mark.parametrize(("off", "wrong"), [(0.9e-3, False), (-0.9e-3, False), (1.1e-3, True), (-1.1e-3, True)])
def test_a_gain_may_differ_by_a_thousandth(off: float, wrong: bool) -> None:
    assert ("but the plan has 7" in told(recovered(sound(), gain=7.0 * (1.0 + off)))[1]) is wrong
    turned = sound() | {"gain": np.repeat([7.0, 7.0 * (1.0 + off)], 16384)}
    assert ("The gain changed" in told(recovered(turned))[1]) is wrong


@pytest.mark.parametrize(("coherence", "low"), [(0.4, True), (0.6, False)])
def test_a_median_coherence_below_a_half_is_explained(coherence: float, low: bool) -> None:
    """White noise is the sensor's: the run is to be repeated."""
    values = sound()
    noise = np.random.default_rng(3).normal(size=len(values["head"]))
    values["heatblock"] = values["head"] + np.sqrt(1.0 / coherence - 1.0) * noise
    good, advice = told(recovered(values))
    assert ("heatblock has a coherence of 0.4" in advice) is low
    assert good is not low


@pytest.mark.parametrize(
    ("odd", "even", "noise", "reported"),
    [
        (0.09, 0.0, 0.01, False),
        (0.11, 0.0, 0.01, True),
        (0.0, 0.11, 0.01, True),
        (0.11, 0.0, 0.12, False),
        (0.13, 0.0, 0.12, True),
    ],
)
def test_distortion_above_a_tenth_and_above_the_noise_is_reported(odd: float, even: float, noise: float, reported: bool) -> None:
    found = _distortion(Detection(response="motor", periods=8, noise=noise, odd=odd, even=even))
    assert (found is not None) is reported


def test_distortion_is_told_with_its_size_and_leaves_the_run_good() -> None:
    found = _distortion(Detection(response="motor", periods=8, noise=0.06, odd=0.6, even=0.0))
    assert found is not None
    assert "with 60 % of the driven ones (noise 6 %)" in found
    # Odd frequencies are driven; the square of their motion has even ones.
    lines = 2 * np.arange(1, 200) + 1
    time = np.arange(32768)[:, None] / 4096.0
    head = np.sin(2.0 * np.pi * time * lines[None, ::2] + np.random.default_rng(4).uniform(0.0, 6.0, len(lines[::2]))).sum(axis=1)
    run = recovered({"head": head, "motor": head + 0.1 * head**2, "table": -head, "heatblock": head})
    assert run.run is not None
    good, advice = told(replace(run, run=replace(run.run, excitation="multisine", period=4096)))
    assert good
    assert "motor responds at frequencies that are not driven" in advice
    assert "heatblock responds" not in advice


def test_coherence_is_that_of_the_responses_within_the_band() -> None:
    values = sound()
    spectrum = np.fft.rfft(np.random.default_rng(5).normal(size=len(values["head"])))
    spectrum[np.fft.rfftfreq(len(values["head"]), 1.0 / 1024.0) < 405.0] = 0.0
    values["heatblock"] = values["head"] + 5.0 * np.fft.irfft(spectrum)
    found = recovered(values)
    verdict = check_run(found, rig=wire_bonder())
    assert set(verdict.coherence) == {"motor", "table", "heatblock"}
    assert verdict.coherence["heatblock"] > 0.95
    assert found.run is not None
    # Without a stated band, the frequencies that the drive excites count.
    unstated = check_run(replace(found, run=replace(found.run, band=None)), rig=wire_bonder())
    assert unstated.coherence["heatblock"] == pytest.approx(verdict.coherence["heatblock"], abs=0.02)


def test_records_of_any_size_are_alive() -> None:
    assert told(recovered({name: 1e-6 * values for name, values in sound().items()}))[0]


def test_of_several_contacts_the_one_that_moves_least_counts() -> None:
    names = (("motor", "table", 0.5), ("table", "foot", 0.1), ("foot", "floor", 0.3))
    contacts = [(SimpleNamespace(a=a, b=b), a, b) for a, b, _ in names]
    rig = SimpleNamespace(configurations=("unlocked",), sensed_contacts=lambda configuration: contacts)
    one = np.array([1.0, -1.0])
    found = least_sliding(
        rig,  # type: ignore[arg-type]
        "unlocked",
        lambda a, b: [[one, (1.0 - next(share for start, _, share in names if start == a)) * one]],
    )
    assert found is not None
    assert found.share == pytest.approx(0.1)
    assert found.text == "The table moved with the foot"


@pytest.mark.parametrize(("share", "stuck"), [(0.19, True), (0.21, False)])
def test_friction_that_holds_a_body_is_reported(share: float, stuck: bool) -> None:
    """Relative motion below a fifth of the motor's own."""
    n = 4096
    head, apart = np.random.default_rng(2).normal(size=(2, n))
    motor = head / head.std()
    apart -= motor * (apart @ motor) / (motor @ motor)
    found = recovered({"head": head, "motor": motor, "table": motor - share * apart / apart.std(), "heatblock": head})
    verdict = check_run(found, rig=wire_bonder())
    assert verdict.sliding == pytest.approx(share, rel=0.01)
    assert any("friction was not overcome" in line for line in verdict.advice) is stuck


def incoherent(run_id: str, drive: FloatArray, related: float = 0.0) -> Run:
    """A run with two responses, the second of which is coherent; so is the first if it is `related` to the drive."""
    draw = np.random.default_rng(len(run_id))
    records = {"force": drive, "x": related * drive + draw.normal(size=len(drive)), "y": 2.0 * drive}
    channels = {name: Channel(name=name, samples=values) for name, values in records.items()}
    return Run(
        id=run_id,
        configuration="unlocked",
        sample_rate=256.0,
        gain=1.0,
        channels=channels,
        excitation="random",
        band=(1.0, 100.0),
    )


@pytest.mark.parametrize(
    ("kinds", "kept", "asked"),
    [
        (("noise", "undecided", "nonlinear"), "nonlinear", 3),  # a nonlinearity is said before what is undecided and noise
        (("nonlinear", "noise", "noise"), "nonlinear", 1),  # and ends the question
        (("undecided", "noise", "noise"), "undecided", 3),
        (("noise", "noise", "noise"), "noise", 3),
    ],
)
def test_each_incoherent_response_has_one_reason(
    kinds: tuple[str, ...], kept: str, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = np.random.default_rng(0).normal(size=4096)
    runs = tuple(incoherent(name, drive) for name in ("a", "bb", "ccc"))
    questions: list[tuple[str, str, tuple[str, ...]]] = []

    def incoherence(run: Run, spectra: object, name: str, drive: str, *, others: Any, detections: object) -> Incoherence:
        questions.append((run.id, name, tuple(other.id for other in others)))
        kind: Any = dict(zip(("a", "bb", "ccc"), kinds, strict=True))[run.id]
        return Incoherence(response=name, kind=kind, text=f"It is {kind}.")

    monkeypatch.setattr(run_check, "incoherence", incoherence)
    (found,) = incoherences(Campaign(runs=runs, source="three"), ["force"])
    assert (found.response, found.kind) == ("x", kept)
    first = ("a", "bb", "ccc")[kinds.index(kept)]
    assert found.text == f"Run {first!r}: It is {kept}."
    assert questions[0] == ("a", "x", ("bb", "ccc"))
    assert len(questions) == asked


def test_no_reason_is_asked_for_where_coherence_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = np.random.default_rng(0).normal(size=4096)
    reason = Incoherence(response="x", kind="noise", text="It is noise.")
    monkeypatch.setattr(run_check, "incoherence", lambda *given, **more: reason)
    one = Campaign(runs=(incoherent("a", drive),), source="one")
    assert incoherences(one, ["force"]) == incoherences(one, ["force"], ["x"])
    # Only the coherent response, none, of several drives, a channel that is missing, related records, and a hammer.
    hits = np.zeros(4096)
    hits[[500, 1500, 2500, 3500]] = 100.0
    assert run_check._spectra(replace(one.runs[0], excitation="moves"), "force") is None
    assert incoherences(one, ["force"], ["y"]) == []
    assert incoherences(one, ["force"], []) == []
    assert incoherences(one, ["force", "y"]) == []
    assert incoherences(one, ["other"]) == []
    assert incoherences(Campaign(runs=(incoherent("a", drive, 2.0),), source="related"), ["force"]) == []
    assert incoherences(Campaign(runs=(incoherent("a", hits),), source="hit"), ["force"]) == []
