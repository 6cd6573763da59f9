"""The chain on rigs that are not the wire bonder: simulate, import of CSV, frf, characterize, isolation, diagnose, report."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from small_rigs import HARDENING, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.estimate_pairs import doubles
from isorig.analysis.diagnose.misfit import discrepancies
from isorig.analysis.diagnose.step import _values
from isorig.analysis.fitting.candidate import Reported
from isorig.analysis.fitting.division import refined
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import Body, Link
from isorig.analysis.parameters.joint_fit import characterize
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.wording import sized
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read, write
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.model.baseline import baseline_model
from isorig.rig.next.proposal import single_driven
from isorig.rig.report.frequency import UNBOUNDED, transfer_section
from isorig.rig.virtual.simulated_recording import described_campaign

#: What only the wire bonder has.
BONDER = re.compile(r"wire.?bonder|heat.?block|\bbond\b|\bthesis|head_mass|\bthe head\b|\bthe motor\b|\bhead\b", re.IGNORECASE)
OTHERS = [name for name in SHIPPED if name != "wire-bonder"]
#: Rigs that take a few seconds each.
QUICK = ("two-carts", "damper-test")
CASES = [pytest.param(name, marks=() if name in QUICK else pytest.mark.study) for name in OTHERS]


def called(capsys: pytest.CaptureFixture[str], *call: str | Path) -> str:
    status = main([str(word) for word in call])
    said = capsys.readouterr()
    assert status == 0, f"{call}: {said.err}"
    assert not (found := BONDER.findall(said.out)), f"{call} says {found}: {said.out}"
    return said.out


def imported(folder: Path, name: str, capsys: pytest.CaptureFixture[str], seconds: float) -> Path:
    """A virtual session that went through CSV files of another program."""
    called(capsys, "virtual", "campaign", "--model", name, "--seconds", str(seconds), "--seed", "1", "-o", folder / "virtual.h5")
    called(capsys, "export", folder / "virtual.h5", "-o", folder / "table.csv")
    campaign = read(folder / "virtual.h5")
    (folder / "rig.toml").write_text(SHIPPED[name].read_text(encoding="utf-8"), encoding="utf-8")
    lines = ['description = "rig.toml"']
    for channel in campaign.runs[0].channels.values():
        lines += [f"[channels.{channel.name}]", f'source = "{channel.name}"', f'unit = "{channel.unit}"']
    for run in campaign.runs:
        file = f"table-{run.id}.csv"
        lines += [
            "[[runs]]", f'id = "{run.id}"', f'file = "{file}"', f'configuration = "{run.configuration}"', f"gain = {run.gain}",
            f"sample_rate = {run.sample_rate}", f'excitation = "{run.excitation}"',
        ]  # fmt: skip
        if run.band is not None:
            lines.append(f"band = {list(run.band)}")
    (folder / "mapping.toml").write_text("\n".join(lines), encoding="utf-8")
    called(capsys, "import", folder / "mapping.toml", "-o", folder / "c.h5")
    return folder / "c.h5"


@pytest.mark.parametrize("name", CASES)
def test_the_chain_says_nothing_of_another_rig(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = imported(tmp_path, name, capsys, 12.0 if name == "hammer-chain" else 6.0)
    truth = read_rig(name).model
    driven = truth.usual.excitation != "free"
    called(capsys, "describe", name)
    called(capsys, "check", recording)
    if driven:
        said = called(capsys, "frf", recording, "--resolution", "1.0", "-o", tmp_path / "frf")
        assert all(sensor.channel in said for sensor in truth.sensors)
    said = called(capsys, "characterize", recording, "-o", tmp_path / "parameters")
    table = json.loads((tmp_path / "parameters" / "parameters.json").read_text())["parameters"]
    for path in truth.free:
        assert path in said
        row = table[path]
        assert abs(row["value"] - truth.get(path)) < 5.0 * row["std"] + 1e-3 * abs(truth.get(path)), path
    configuration = read(recording).runs[0].configuration
    # A single configuration needs no name.
    set_up = f"{configuration}." if len(truth.configurations) > 1 else ""
    for k, mode in enumerate(natural_modes(truth, configuration)):
        row = table[f"{set_up}mode{k + 1}.frequency"]
        assert row["value"] == pytest.approx(mode.frequency, abs=5.0 * row["std"] + 1e-3 * mode.frequency)
    if driven:
        model = tmp_path / "parameters" / "model.json"
        said = called(capsys, "isolation", recording, "--model", model, "-o", tmp_path / "isolation")
        assert "Measured: |" in said
        assert "Simulated: |" in said
    said = called(capsys, "diagnose", recording, "--seconds", "120", "-o", tmp_path / "diagnosis")
    findings = json.loads((tmp_path / "diagnosis" / "findings.json").read_text())
    # Two commands fit the same runs: they agree whether the model explains them, and on the values.
    assert findings["verdict"] == "adequate", said
    assert "unexplained" not in " ".join(row["note"] for row in table.values())
    for path, row in findings["baseline"]["parameters"].items():
        other = table[path]
        assert row["value"] == pytest.approx(other["value"], abs=3.0 * (row["std"] + other["std"]) + 1e-3 * abs(other["value"]))
    called(capsys, "report", recording, "-o", tmp_path / "report")
    for page in (tmp_path / "report" / "report.html", tmp_path / "diagnosis" / "report.html"):
        text = re.sub(r"<(script|style).*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        text = re.sub(r"<[^>]*>", " ", text)
        assert not (found := [m for m in BONDER.findall(text) if m != "head"]), found


def test_a_table_of_another_rig_is_no_wire_bonder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = {
        "format": "rig-parameters", "format_version": 1,
        "parameters": {"links.wall.stiffness": {"value": 410.0, "std": 1.0, "unit": "N/m", "method": "joint fit", "note": ""}},
    }  # fmt: skip
    (tmp_path / "parameters.json").write_text(json.dumps(content))
    assert main(["simulate", "--parameters", str(tmp_path / "parameters.json"), "-o", str(tmp_path / "a.h5")]) == 2
    assert "another rig than the wire bonder" in capsys.readouterr().err
    assert main(["virtual", "campaign", "--model", "two-carts", "--hide", "end_stop", "-o", str(tmp_path / "a.h5")]) == 2
    assert "omit them for two carts" in capsys.readouterr().err


def test_isolation_between_two_configurations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    called(capsys, "virtual", "campaign", "--model", "absorber", "--seconds", "20", "-o", tmp_path / "c.h5")
    call = (
        "isolation",
        tmp_path / "c.h5",
        "--response",
        "platform",
        "--configurations",
        "unlocked",
        "wedged",
        "--resolution",
        "0.5",
    )
    said = called(capsys, *call, "-o", tmp_path / "i")
    assert "|platform / shaker| unlocked, relative to wedged, from 1 to 60 Hz" in said
    rows = np.genfromtxt(tmp_path / "i" / "isolation-measured-gain1.csv", delimiter=",", names=True)
    # The absorber takes the platform's motion away where it is tuned, which no wedged absorber does: linear theory.
    model = read_rig("absorber").model
    f = rows["frequency_hz"]
    sizes = []
    for configuration in ("unlocked", "wedged"):
        k, c = (np.array([[model.get(f"links.{n}.{key}") for n in ("legs", "absorber")]]) for key in ("stiffness", "damping"))
        s = 2j * np.pi * f
        z = (k + c * s[:, None]).T
        if configuration == "wedged":
            sizes.append(np.abs(s**2 / (63.0 * s**2 + z[0])))
        else:
            sizes.append(np.abs(s**2 / (60.0 * s**2 + z[0] + z[1] - z[1] ** 2 / (3.0 * s**2 + z[1]))))
    away = np.abs(f - 7.77) > 2.5  # the window smears the narrow peak of the wedged one
    off = np.abs(rows["ratio"] - sizes[0] / sizes[1])[away]
    assert (off < 4.0 * rows["ratio_std"][away] + 0.03).all()
    assert main([*map(str, call[:4]), "--configurations", "unlocked", "locked", "-o", str(tmp_path / "j")]) == 2
    assert "it has unlocked, wedged" in capsys.readouterr().err


def test_the_reference_is_the_descriptions_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    called(capsys, "virtual", "campaign", "--model", "two-carts", "--seconds", "10", "-o", tmp_path / "c.h5")
    called(capsys, "frf", tmp_path / "c.h5", "--resolution", "0.5", "-o", tmp_path / "frf")
    assert (tmp_path / "frf" / "x1-over-u-gain1.csv").exists()
    called(capsys, "export", tmp_path / "c.h5", "--what", "frf", "-o", tmp_path / "frf.csv")
    assert "x2" in (tmp_path / "frf.csv").read_text()


@pytest.mark.study
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("name", ["hammer-chain", "two-carts"])
def test_intervals_cover_the_truth(name: str) -> None:
    """95 % intervals of `rig characterize` over campaigns with other noise, drives and first guesses."""
    given = read_rig(name)
    inside: list[bool] = []
    for seed in range(100):
        draw = np.random.default_rng(1000 + seed)
        campaign: Campaign = described_campaign(given, seed=seed, noise=5e-3, seconds=8.0)
        guess = baseline_model(campaign)
        guess = guess.replace({path: guess.get(path) * float(draw.uniform(0.8, 1.25)) for path in guess.free})
        table = characterize(campaign, guess).table
        for path in given.model.free:
            entry = table[path]
            assert entry.value is not None
            assert entry.std is not None
            inside.append(abs(entry.value - given.model.get(path)) <= 1.96 * entry.std)
    share = float(np.mean(inside))
    print(f"{name}: {100 * share:.1f} % of {len(inside)} intervals cover the truth")
    assert 0.92 <= share <= 0.98


@pytest.mark.parametrize("hidden", ["hardening", "extra mode"])
def test_an_extended_model_is_characterized_as_it_was_diagnosed(
    hidden: str, hardened: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = read_rig("two-carts")
    rig = given.model
    if hidden == "hardening":
        truth = with_law(rig, "between", Cubic(cubic_stiffness=HARDENING))
        folder, own = hardened, {"links.between.laws.0.cubic_stiffness": (HARDENING, "N/m^3")}
    else:
        load = Body(name="load", mass=0.12), Link(name="load", a="load", b="second", stiffness=90.0, damping=0.1)
        truth = replace(rig, bodies=(*rig.bodies, load[0]), links=(*rig.links, load[1]))
        folder, own = (
            tmp_path,
            {
                "bodies.second_added.mass": (0.12, "kg"),
                "links.second_added.stiffness": (90.0, "N/m"),
                "links.second_added.damping": (0.1, "N s/m"),
            },
        )
        write(folder / "c.h5", described_campaign(given, seed=3, seconds=10.0, truth=truth))
        called(capsys, "diagnose", folder / "c.h5", "-o", folder / "d")
    model = folder / "d" / "model.json"
    said = called(capsys, "characterize", folder / "c.h5", "--model", model, "-o", tmp_path / "p")
    table = json.loads((tmp_path / "p" / "parameters.json").read_text())["parameters"]
    expected = {path: (rig.get(path), table[path]["unit"]) for path in rig.free} | own
    for path, (value, unit) in expected.items():
        row = table[path]
        # To the digits that the uncertainty justifies.
        assert re.search(rf"{re.escape(path)} +{re.escape(sized(row['value'], unit, row['std']))} ", said), path
        assert row["unit"] == unit
        assert abs(row["value"] - value) < 4.0 * row["std"], path
        assert row["std"] < 5e-3 * value, path
    # Both commands fit the same model to the same runs.
    findings = json.loads((folder / "d" / "findings.json").read_text())
    found = {row["unit"]: row for row in findings["steps"][0]["parameters"].values()}
    for path, (_, unit) in own.items():
        if unit in found:
            assert table[path]["value"] == pytest.approx(found[unit]["value"], abs=found[unit]["std"])
    error = float(re.search(r"held-out error ([\d.]+) %", said).group(1))  # type: ignore[union-attr]
    assert error == pytest.approx(100.0 * findings["holdout"]["extended"], rel=0.05)
    modes = natural_modes(truth, "unlocked")
    assert sum(name.endswith(".frequency") for name in table) == len(modes)
    for k, mode in enumerate(modes):
        row = table[f"mode{k + 1}.frequency"]
        assert abs(row["value"] - mode.frequency) < 4.0 * row["std"]
    # The baseline alone leaves the error that the diagnosis reports.
    called(capsys, "characterize", folder / "c.h5", "--model", folder / "d" / "baseline.json", "-o", tmp_path / "b")
    table = json.loads((tmp_path / "b" / "parameters.json").read_text())["parameters"]
    assert "of the signal unexplained; see rig diagnose" in table["drive.factor"]["note"]


def test_a_report_shows_every_drive_and_proposals_refuse_several(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = read_rig("two-shakers")
    campaign = described_campaign(given, seed=1, seconds=12.0)
    page = transfer_section(campaign, given.model)
    assert [chart.name for chart in page.charts] == [
        f"frf-{response}-over-{drive}" for response in ("a_left", "a_right") for drive in ("f_left", "f_right")
    ]
    assert "H1 from f_left and f_right" in page.text[0]
    falling = laws.Curve(over="deflection", at=(-1e-4, 1e-4), values=(1e3, -1e3))
    first, *others = given.model.links
    unstable = msgspec.structs.replace(given.model, links=(msgspec.structs.replace(first, laws=(falling,)), *others))
    page = transfer_section(campaign, unstable)
    assert UNBOUNDED in page.text
    assert page.charts
    with pytest.raises(PlanError, match=r"has the drives f_left, f_right, and runs are proposed for a rig with a single drive"):
        single_driven(given.model)


def test_the_ratio_and_the_contacts_are_those_of_the_description() -> None:
    absorber, bonder = read_rig("absorber").model, read_rig("wire-bonder").model
    assert absorber.usual_ratio == ("absorber", "shaker", ("unlocked", "wedged"))
    assert bonder.usual_ratio == ("heatblock", "head", ("unlocked", "locked"))
    assert [(c.name, a, b) for c, a, b in bonder.sensed_contacts("unlocked")] == [("isolation", "motor", "table")]
    assert bonder.sensed_contacts("locked") == ()
    # A model whose absorber is too stiff, and the sentence on the ratio of the two configurations.
    campaign = described_campaign(read_rig("absorber"), seed=1, seconds=20.0)
    wrong = absorber.replace({"links.absorber.stiffness": 9000.0})
    trials = tuple(refined(trial) for trial in prepare(campaign, wrong))
    found = discrepancies(campaign, wrong, trials, doubles(wrong, trials))
    (ratio,) = (item for item in found if item.what == "ratio")
    assert (ratio.channel, ratio.configuration) == ("absorber", "unlocked")
    assert "ratio |absorber / shaker|, unlocked over wedged" in ratio.text


def test_a_measured_base_is_proposed_as_an_imposed_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(600) / 500.0
    table = np.column_stack([t, 0.1 * np.sin(40.0 * t), 0.2 * np.sin(40.0 * t)])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t [s],base [g],device [g]", comments="")
    called(capsys, "import", "--draft", tmp_path / "a.csv", "-o", tmp_path / "map.toml")
    called(capsys, "describe", tmp_path / "map-rig.toml")
    model = read_rig(tmp_path / "map-rig.toml").model
    assert model.imposed == ("body_base",)
    assert (model.link("link_device").a, model.link("link_device").b) == ("body_device", "body_base")


def test_units_of_a_cause_at_a_rotating_part() -> None:
    model = read_rig("belt-pair").model
    path = f"contacts.{model.contacts[0].name}.law.friction_force"
    fitted = Fit(model=model, free=(Free(path=path),), covariance=np.eye(1), cost=1.0, evaluations=0)
    found = _values([Reported(name="friction_force", path=path, unit="N")], fitted)
    assert found["friction_force"][2] == "N m"
