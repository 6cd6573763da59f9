"""What notebooks get: the campaign's own rig, conversions with units and coordinates, state-space models, figures, texts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.signal import lsim

import isorig as iso
from isorig.analysis.errors import AnalysisError, ModelError
from isorig.analysis.simulate.natural import natural_modes
from isorig.rig.files.parameter_table import characterize_campaign
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign

#: Shipped rigs without friction and laws, whose drive is a force or an imposed acceleration.
LINEAR = ("absorber", "two-carts", "hammer-chain", "shaken-base", "rocking-table", "two-shakers", "free-free-pair")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> iso.Campaign:
    """Two carts, read from a file."""
    path = tmp_path_factory.mktemp("carts") / "c.h5"
    write(path, described_campaign(read_rig("two-carts"), seed=1, seconds=20.0))
    return iso.read(path)


def test_a_campaign_has_its_rig(campaign: iso.Campaign) -> None:
    assert campaign.rig == read_rig("two-carts").model
    take = iso.VirtualRun(id="a", configuration="unlocked", gain=70.0, seconds=2.0, start=0.0)
    bonder = iso.virtual_campaign(iso.wire_bonder(), [take])
    assert bonder.rig.name == "wire bonder"
    assert bonder.rig.get("bodies.motor.mass") == bonder.known["motor_mass"]
    without = replace(campaign.runs[0], channels={k: v for k, v in campaign.runs[0].channels.items() if k != "x2"})
    with pytest.raises(iso.RigError, match="lacks channel 'x2'"):
        _ = replace(campaign, runs=(without,)).rig


@pytest.mark.parametrize("name", LINEAR)
def test_state_space_moves_as_the_simulation(name: str) -> None:
    model = read_rig(name).model
    rate, n = 4096.0, 8192
    rng = np.random.default_rng(3)
    # A smooth drive: the simulation band-limits it between samples, lsim interpolates linearly.
    window = np.hanning(n) * (np.arange(n) > 400)
    drives = [window * np.convolve(rng.normal(size=n), np.hanning(301), mode="same") for _ in model.drives]
    response = iso.simulate(
        model, iso.Excitation.prepare(drives[0], rate, others=drives[1:]), configuration=next(iter(model.configurations))
    )
    system = model.state_space()
    _, found, _ = lsim(system.to_scipy(), np.column_stack(drives), np.arange(n) / rate)
    found = found.reshape(n, -1)
    for k, channel in enumerate(system.outputs):
        expected = response.channels[channel]
        assert np.std(found[:, k] - expected) < 0.01 * np.std(expected), channel


def test_state_space_has_the_modes_and_names() -> None:
    model = iso.wire_bonder()
    for configuration in model.configurations:
        system = model.state_space(configuration)
        control = system.to_control()
        poles = np.sort(np.abs(control.poles()))[::2] / (2.0 * np.pi)
        assert poles == pytest.approx([mode.frequency for mode in natural_modes(model, configuration)], rel=1e-6)
        assert control.input_labels == ["head"]
        assert control.output_labels == ["motor", "table", "heatblock"]
    assert system.units == dict.fromkeys(("head", "motor", "table", "heatblock"), "m/s^2")


@pytest.mark.parametrize(("name", "words"), [("damper-test", "imposes a displacement"), ("unknown", "configuration 'unknown'")])
def test_state_space_is_refused_in_one_sentence(name: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        read_rig("damper-test").model.state_space() if name == "damper-test" else iso.wire_bonder().state_space(name)


def test_runs_convert_with_time_and_units(campaign: iso.Campaign) -> None:
    run = campaign.runs[0]
    data, frame = run.to_xarray(), run.to_pandas()
    assert data["x1"].attrs["units"] == frame.attrs["units"]["x1"] == "m"
    assert data["u"].attrs["units"] == "V"
    assert data["time"].attrs["units"] == "s"
    assert np.array_equal(data["x1"], run.read("x1"))
    assert np.array_equal(frame["x1"], run.read("x1"))
    assert float(frame.index[-1]) == float(data["time"][-1]) == pytest.approx(run.duration - 1.0 / run.sample_rate)
    tree = campaign.to_xarray()
    assert list(tree) == [run.id for run in campaign.runs]
    assert list(campaign.to_pandas().index) == list(tree)


def test_one_transfer_function_serves_all(campaign: iso.Campaign) -> None:
    found = iso.frf(campaign, reference="u", resolution=0.1)
    assert all(item.frf is item for item in found)
    first = found[0]
    data, frame = first.to_xarray(), first.to_pandas()
    assert np.array_equal(data["value"], first.value)
    assert np.array_equal(frame.index, first.frequency)
    assert data["value"].attrs["units"] == frame.attrs["units"]["value"] == "(m)/(V)"
    assert data["phase_std"].attrs["units"] == "rad"
    assert data.attrs["configuration"] == "unlocked"
    # The same objects are fitted one by one, and together.
    alike = [item for item in found if item.gain == first.gain and item.level == first.level]
    assert {item.response for item in alike} == {"x1", "x2"}
    modes = iso.modes(alike, (0.5, 6.0))
    truth = [mode.frequency for mode in natural_modes(campaign.rig, "unlocked")]
    assert [mode.frequency for mode in modes.modes] == pytest.approx(truth, rel=0.01)
    one = iso.fit_modes(alike[0], (0.5, 6.0), kind="general")
    assert min(abs(mode.frequency - truth[0]) for mode in one.modes) < 0.02 * truth[0]
    assert list(modes.to_pandas()["frequency"]) == [mode.frequency for mode in modes.modes]
    shapes = modes.to_xarray()["shape"]
    assert shapes.dims == ("response", "mode")
    assert np.array_equal(shapes, modes.shapes())


def test_characterize_gives_the_numbers_of_the_command(campaign: iso.Campaign) -> None:
    found, same = iso.characterize(campaign), characterize_campaign(campaign, lambda text: None)
    assert {name: entry.value for name, entry in found.table.items()} == {name: entry.value for name, entry in same.table.items()}
    frame, data = found.to_pandas(), found.to_xarray()
    name = "links.between.stiffness"
    assert frame.loc[name, "value"] == float(data[name]) == found.table[name].value
    assert frame.loc[name, "unit"] == data[name].attrs["units"] == "N/m"
    assert data[name].attrs["std"] == found.table[name].std


def test_diagnose_takes_the_campaigns_rig_and_a_time_limit(campaign: iso.Campaign, tmp_path: Path) -> None:
    found = iso.diagnose(campaign)
    assert found.verdict == "adequate"
    assert repr(found).startswith("Answer(adequate: the model explains the data down to the noise; the error on held-out data is")
    assert "adequate" in found._repr_html_()
    assert isinstance(found.plot(), Figure)
    assert list(found.to_pandas().columns) == ["cause", "location", "holdout_error", "share", "standing"]
    with pytest.raises(AnalysisError, match="Answer has no to_xarray here; use plot or to_pandas"):
        found.to_xarray()
    page = found.write(tmp_path / "out")
    assert page.is_file()
    assert (tmp_path / "out" / "findings.json").is_file()
    assert iso.diagnose(campaign, seconds=1e-6).cut_short


def test_every_text_is_short(campaign: iso.Campaign) -> None:
    drive = iso.Excitation.prepare(campaign.runs[0].read("u"), campaign.runs[0].sample_rate)
    spectra = iso.estimate(campaign.runs, references=["u"], resolution=0.5)
    fitted = iso.fit_modes(iso.frf(campaign, reference="u", resolution=0.1)[0], (0.5, 6.0))
    for result in (drive, iso.trace(campaign.rig, drive), spectra, fitted, campaign.runs[0]):
        assert len(repr(result)) < 250, repr(result)
        assert "array" not in repr(result)


def test_every_result_has_a_figure_a_page_and_a_short_text(campaign: iso.Campaign) -> None:
    frfs = iso.frf(campaign, reference="u", resolution=0.1)
    drive = iso.Excitation.prepare(campaign.runs[0].read("u"), campaign.runs[0].sample_rate)
    response = iso.simulate(campaign.rig, drive)
    results = [campaign, campaign.runs[0], frfs[0], response, iso.modes(frfs[:1], (0.5, 6.0)), iso.characterize(campaign)]
    for result in results:
        assert len(repr(result)) < 250, repr(result)
        ElementTree.fromstring(result._repr_html_())
        figure = result.plot()
        assert isinstance(figure, Figure)
        labels = [axis.get_xlabel() + axis.get_ylabel() for axis in figure.axes]
        assert any(", " in label or "%" in label for label in labels), labels
    assert frfs[0].plot(*frfs[1:]).axes[0].get_legend() is not None
    assert response.to_xarray()["x1"].attrs["units"] == "m"
    drawing = campaign.rig.plot()
    assert ElementTree.fromstring(drawing._repr_svg_()).tag.endswith("svg")
    assert ElementTree.fromstring(campaign.rig._repr_html_()).tag.endswith("svg")
    assert repr(campaign.rig) == "Rig('two carts', bodies first, second; drive u; sensors x1, x2; 6 free)"
    assert repr(campaign.runs[0].channels["x1"]) == f"Channel('x1', displacement in m, {len(campaign.runs[0])} samples)"
