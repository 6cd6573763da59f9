"""Excitations that contradict the drive are reported; those of shipped rigs, and of drives that do not show it, are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import chirp

import isorig as iso
from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.spectra.stated_drives import wrong_excitations
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.virtual.simulated_recording import described_campaign

RATE, SECONDS = 256.0, 12.0
TIME = np.arange(int(RATE * SECONDS)) / RATE


def noise(low: float, high: float) -> FloatArray:
    lines = np.fft.rfft(np.random.default_rng(3).normal(0.0, 1.0, len(TIME)))
    frequency = np.fft.rfftfreq(len(TIME), 1.0 / RATE)
    return np.fft.irfft(np.where((frequency >= low) & (frequency <= high), lines, 0.0), len(TIME))


def decay() -> FloatArray:
    return np.exp(-TIME) * np.sin(30.0 * TIME)


DRIVES = {
    "noise": noise(0.5, 40.0),
    "narrow noise": noise(10.0, 12.0),
    "sweep": chirp(TIME, 0.5, SECONDS, 40.0),
    "logarithmic sweep": chirp(TIME, 0.5, SECONDS, 40.0, method="logarithmic"),
    "fast sweeps": chirp(TIME % 0.6, 0.5, 0.6, 40.0),
    "decay": decay(),
    "nothing": np.zeros(len(TIME)),
}


def recorded(drive: FloatArray, excitation: str, response: FloatArray | None = None) -> Campaign:
    samples = {"u": drive, "x": drive if response is None else response}
    channels = {name: iso.Channel(name=name, samples=values) for name, values in samples.items()}
    run = iso.Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation=excitation)
    return iso.Campaign(runs=(run,))


@pytest.mark.parametrize(
    ("drive", "excitation", "said"),
    [
        ("noise", "sweep", "states the excitation sweep, but its drive 'u' has all of its frequencies at any time: write random"),
        ("sweep", "random", "states the excitation random, but its drive 'u' has one frequency at a time"),
        ("logarithmic sweep", "multisine", "states the excitation multisine, but its drive 'u' has one frequency at a time"),
        ("noise", "free", "states the excitation free, but its drive 'u' and all responses are as large to the end"),
        ("noise", "random", ""),
        ("noise", "other", ""),
        ("narrow noise", "sweep", ""),
        ("sweep", "sweep", ""),
        ("logarithmic sweep", "sweep", ""),
        ("fast sweeps", "sweep", ""),
        ("fast sweeps", "random", ""),
        ("decay", "free", ""),
        ("nothing", "free", ""),
        ("nothing", "random", ""),
    ],
)
def test_what_contradicts_the_drive_is_reported(drive: str, excitation: str, said: str) -> None:
    found = wrong_excitations(recorded(DRIVES[drive], excitation), "u")
    assert len(found) == bool(said)
    assert said in "".join(found)


def test_a_release_with_a_disturbed_drive_channel_is_free() -> None:
    assert wrong_excitations(recorded(noise(0.5, 40.0), "free", decay()), "u") == []


@pytest.mark.parametrize("name", SHIPPED)
def test_excitations_of_sound_rigs_are_right(name: str) -> None:
    given = read_rig(name)
    assert wrong_excitations(described_campaign(given, seed=4, seconds=10.0), given.model.drive.channel) == []
