"""Draws a sealed campaign: a rig of a family with hidden effects, measured by an instrument of another hand, and its answer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import motion
import numpy as np
from effects import EFFECTS, PAIRS, Hidden, Swing, places, soil
from instrument import CONVERTERS, FloatArray, Input, converted, faulty, late, upsampled, write
from motion import Elongation, Law, Rub, Seen, Spring
from rigs import FAMILIES, GROUND, ORDER, WRONG, Draw, Rig, Take, described

#: Share of every signal that a soiled rig has from parts that nobody modelled.
SOIL = 0.02
#: An effect of full size changes at least one record by this share of its rms; otherwise place and numbers are drawn again.
CLEAR, ATTEMPTS = 0.1, 12
#: Mass of a body whose motion is imposed, kg.
IMPOSED = 1e9
#: Seconds of the runs that measure the rig's motion and the change by an effect.
TRIAL = 15.0


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How a campaign is drawn; what is None is drawn by the seed.

    Parameters
    ----------
    severity
        1 is full size.
    soiled
        Whether small disturbances are in every signal.
    effects
        Names in `EFFECTS`; "none", "one" or "two" leave the names to the seed.
    finest
        Fine steps per second at least. Dry friction and stops are exact to the first order of a step: 32768 Hz is a few parts
        in ten thousand of a parameter.
    """

    severity: float | None = None
    soiled: bool | None = None
    effects: tuple[str, ...] | None = None
    finest: float = 32768.0


def _steps(rig: Rig) -> int:
    return 2 * int(np.ceil(rig.finest / rig.rate / 2.0))


def _wave(rig: Rig, take: Take, rest: float) -> FloatArray:
    # The drive at twice the sample rate.
    rate = 2.0 * rig.rate
    n, draw = round(take.seconds * rate), np.random.default_rng(take.wave)
    t = np.arange(n) / rate
    size = rig.rms * take.level
    if take.kind == "random":
        f = np.fft.rfftfreq(n, 1.0 / rate)
        low, high = take.band
        mask = np.clip((f - 0.8 * low) / (0.2 * low), 0.0, 1.0) * np.clip((1.02 * high - f) / (0.02 * high), 0.0, 1.0)
        wave = np.fft.irfft(np.fft.rfft(draw.normal(0.0, 1.0, n)) * mask, n)
        wave *= size / np.std(wave) * np.minimum(t / 0.5, 1.0)
    elif take.kind == "moves":
        # Accelerate and brake, over random distances, with pauses.
        wave, at = np.zeros(n), 0.3
        while at < take.seconds - 0.5:
            lobe, side = draw.uniform(0.02, 0.05), float(draw.choice([-1.0, 1.0]))
            for begin, sign in ((at, side), (at + lobe, -side)):
                part = (t >= begin) & (t < begin + lobe)
                wave[part] += sign * 3.3 * size * np.sin(np.pi * (t[part] - begin) / lobe) ** 2
            at += 2 * lobe + draw.uniform(0.05, 0.5)
    else:
        level, wave, at = 0.0, np.zeros(n), 0.0
        while at < take.seconds:
            level = size * draw.uniform(-1.7, 1.7)
            wave[round(at * rate) :] = level
            at += draw.uniform(0.8, 2.5)
        # The amplifier follows within some hundredths of a second.
        from scipy.signal import butter, lfilter

        b, a = butter(2, 12.0, fs=rate)
        wave = lfilter(b, a, wave)
    return np.concatenate([np.zeros(round(rest * rate)), wave])


def _elongation(rig: Rig, a: str, b: str, arms: dict[str, float]) -> Elongation:
    names = list(rig.bodies)
    weights = {a: 1.0, **arms}
    if b != GROUND:
        weights[b] = weights.get(b, 0.0) - 1.0
    return Elongation(bodies=tuple(names.index(n) for n in weights), weights=tuple(weights.values()))


def _moved(h: Hidden, take: Take, drive: FloatArray, floor: FloatArray, seen: Sequence[Seen], begin: float) -> FloatArray:
    rig = h.rig
    along = {x.name: _elongation(rig, x.a, x.b, x.arms) for x in rig.links}
    springs = [
        Spring(along=along[x.name], stiffness=x.k, damping=x.c, floor=x.b == GROUND and not rig.turns and x.name != "bearings")
        for x in rig.links
    ]
    order = {x.name: k for k, x in enumerate(rig.links)}
    laws = [Law(name=name, spring=order[place], parameters=p) for place, name, p in h.laws]
    locked = rig.locks if take.configuration == "locked" else ()
    rubs = [Rub(name="lock", along=along[name], parameters=()) for name in locked if h.lock is None or name != "isolation"]
    if locked and h.lock is not None:
        springs.append(Spring(along=along["isolation"], stiffness=h.lock[0], damping=h.lock[1], floor=False))
    frictions = {x.name: ("coulomb", (x.force,)) for x in rig.rubs} | h.rubs
    rubs += [
        Rub(name=rub[0], along=along[place], parameters=rub[1], uneven=h.uneven.get(place, (0.0, 1.0, 0.0)))
        for place, rub in frictions.items()
        if rub is not None and place not in locked
    ]
    masses = [IMPOSED if name == rig.imposes else mass for name, mass in rig.bodies.items()]
    pushes = {rig.imposes: IMPOSED / rig.factor} if rig.imposes else rig.pushes
    push = np.array([pushes.get(name, 0.0) for name in rig.bodies])
    return motion.run(
        masses, springs, laws, rubs, seen, push, rig.factor * drive, floor, 1.0 / (_steps(rig) * rig.rate), begin=begin
    )


def _seen(rig: Rig) -> list[Seen]:
    return [Seen(along=_elongation(rig, x.body, x.relative_to, x.arms), order=ORDER[x.quantity]) for x in rig.sensors]


def _fine(rig: Rig, take: Take, rest: float = 0.0) -> FloatArray:
    return upsampled(_wave(rig, take, rest), _steps(rig) // 2)


def swing_of(rig: Rig) -> Swing:
    """The sound rig's motion at its highest level."""
    take = replace(max((t for t in rig.takes if t.configuration == "unlocked"), key=lambda t: t.level), seconds=TRIAL)
    drive = _fine(rig, take)
    links = [
        Seen(along=_elongation(rig, x.a, x.b, x.arms), order=order) for order in (0, 1) for x in rig.links
    ]  # fmt: skip
    out = np.abs(_moved(Hidden(rig=rig), take, drive, np.zeros_like(drive), [*links, *_seen(rig)], 0.0)).max(axis=1)
    count = len(rig.links)
    names = [x.name for x in rig.links]
    peaks = dict(zip([x.channel for x in rig.sensors], out[2 * count :].tolist(), strict=True))
    return Swing(
        deflection=dict(zip(names, out[:count].tolist(), strict=True)),
        speed=dict(zip(names, out[count : 2 * count].tolist(), strict=True)),
        peak={**peaks, rig.drive: float(np.abs(drive).max())},
        seconds=rig.takes[-1].begin + rig.takes[-1].seconds,
    )  # fmt: skip


def records_of(
    h: Hidden, take: Take, converter: str | None, floor: float = 0.0, rest: float = 0.0, begin: float | None = None
) -> dict[str, FloatArray]:
    """The channels of a run without noise, by channel, each shape (n,).

    Parameters
    ----------
    h, take
        What is measured.
    converter
        One of `CONVERTERS`, or None for encoders.
    floor
        rms displacement of the floor, m.
    rest
        Seconds before the drive begins.
    begin
        Seconds of the session at the first sample; as the run states if None.
    """
    rig, over = h.rig, _steps(h.rig)
    drive = _fine(rig, take, rest)
    shaken = np.zeros_like(drive)
    if floor:
        from scipy.signal import butter, sosfilt

        coarse = np.random.default_rng([*take.id.encode(), 1]).normal(0.0, 1.0, (len(drive) // over + 1) * 2)
        coarse = sosfilt(butter(2, [2.0, 20.0], btype="band", fs=2.0 * rig.rate, output="sos"), coarse)
        shaken = floor / np.std(coarse) * upsampled(coarse, over // 2)[: len(drive)]
    fine = _moved(h, take, drive, shaken, _seen(rig), take.begin if begin is None else begin)
    names = [rig.drive, *(x.channel for x in rig.sensors)]
    rows = np.concatenate([drive[None], fine])
    for k, name in enumerate(names):
        if name in h.chains and h.chains[name].delay:
            rows[k] = late(rows[k], h.chains[name].delay * over * rig.rate)
    found = converted(rows, over, converter, len(drive) // over)
    phase = float(np.random.default_rng([*take.id.encode(), 2]).uniform(0.0, 2 * np.pi))
    return faulty(dict(zip(names, found, strict=True)), h.chains, rig.rate, phase)


def _applied(rig: Rig, chosen: Sequence[tuple[str, str]], swing: Swing, size: float, seeds: Sequence[int]) -> Hidden:
    h = Hidden(rig=deepcopy(rig))
    for (name, place), seed in zip(chosen, seeds, strict=True):
        parameters = EFFECTS[name].make(h, swing, place, size, np.random.default_rng(seed))
        h.told.append({
            "effect": name, "cause": EFFECTS[name].cause, "kinds": list(EFFECTS[name].kinds), "place": place,
            "parameters": {key: float(value) for key, value in parameters.items()},
        })  # fmt: skip
    return h


def _change(before: Hidden, after: Hidden, swing: Swing, converter: str | None) -> dict[str, float]:
    # Largest change of each record as a share of its rms, in the strongest, the weakest and a locked run.
    rig = before.rig
    unlocked = sorted((t for t in rig.takes if t.configuration == "unlocked" and t.kind != "moves"), key=lambda t: t.level)
    chosen = [unlocked[0], unlocked[-1], *[t for t in rig.takes if t.configuration == "locked"][-1:]]
    most: dict[str, float] = {}
    for take in (replace(one, seconds=TRIAL) for one in chosen):
        sound = records_of(before, take, converter, begin=0.9 * swing.seconds)
        other = records_of(after, take, converter, begin=0.9 * swing.seconds)
        for name, values in sound.items():
            change = float(np.std(other[name] - values) / np.std(values))
            most[name] = max(most.get(name, 0.0), change)
    return most


def _choice(rig: Rig, draw: Draw, wanted: tuple[str, ...] | None) -> tuple[str, ...]:
    # Names of effects that the rig has a place for.
    possible = [name for name in EFFECTS if places(name, rig)]
    if wanted is None:
        wanted = (str(draw.choice(["none", "one", "two"], p=[0.1, 0.75, 0.15])),)
    if wanted == ("none",):
        return ()
    if wanted == ("one",):
        return (str(draw.choice(possible)),)
    if wanted == ("two",):
        pairs = [pair for pair in PAIRS if set(pair) <= set(possible)]
        return pairs[int(draw.integers(len(pairs)))]
    return wanted


def draw(family: str, seed: int, setting: Setting, folder: Path) -> tuple[Path, Path] | None:
    """Draw a campaign and write its recording and its answer; None if this rig has no place for the effects.

    Parameters
    ----------
    family
        One of `FAMILIES`.
    seed
        RigValues of everything.
    setting
        What the caller decides.
    folder
        Folder of `SEED.h5` and `SEED.json`.
    """
    draw_ = np.random.default_rng([seed, list(FAMILIES).index(family)])
    rig = replace(FAMILIES[family](draw_), finest=setting.finest)
    converter = None if rig.counts else str(draw_.choice(list(CONVERTERS)))
    severity = setting.severity if setting.severity is not None else float(draw_.choice([1.0, 1.0 / 3.0]))
    soiled = setting.soiled if setting.soiled is not None else bool(draw_.random() < 0.5)
    rest = float(draw_.uniform(0.3, 2.0)) if rig.counts or draw_.random() < 0.5 else 0.0
    swing = swing_of(rig)
    for attempt in range(ATTEMPTS):
        more = np.random.default_rng([seed, attempt, 5])
        names = _choice(rig, more, setting.effects)
        if not all(places(name, rig) for name in names):
            return None
        chosen = [(name, str(more.choice(places(name, rig)))) for name in names]
        seeds = [int(x) for x in more.integers(2**31, size=len(chosen))]
        alone = [_applied(rig, [one], swing, 1.0, [s]) for one, s in zip(chosen, seeds, strict=True)]
        sound = Hidden(rig=rig)
        changes = [_change(sound, h, swing, converter) for h in alone]
        beside = changes
        if len(alone) == 2:
            # Each must show where the other is, too: friction may keep a body from its stop.
            both = _applied(rig, chosen, swing, 1.0, seeds)
            beside = [_change(other, both, swing, converter) for other in reversed(alone)]
        clear = (min(max(one.values()), max(two.values())) >= CLEAR for one, two in zip(changes, beside, strict=True))
        if all(h.known or shows for h, shows in zip(alone, clear, strict=True)):
            break
    h = _applied(rig, chosen, swing, severity, seeds)
    told = h.told
    disturbances: list[tuple[str, str]] = []
    floor = 0.0
    if soiled:
        disturbances = soil(h, swing, SOIL, draw_)
        grounded = [swing.deflection[x.name] for x in rig.links if x.b == GROUND]
        floor = 0.1 * SOIL * max(grounded, default=0.0)
    records = {take.id: records_of(h, take, converter, floor, rest) for take in rig.takes}
    inputs = _inputs(rig, records, draw_)
    wrong = {path: float(np.exp(draw_.uniform(-np.log(WRONG), np.log(WRONG)))) for path in rig.unknown} | h.known
    known: dict[str, float | str] = {}
    if family == "wire_bonder":
        known = _known(rig, wrong)
    if family != "wire_bonder" or draw_.random() < 0.5:
        known["description"] = described(rig, wrong)
    runs: dict[str, dict[str, object]] = {
        take.id: {
            "configuration": take.configuration, "sample_rate": rig.rate, "gain": take.level,
            "excitation": {"random": "random", "moves": "moves", "steps": "other"}[take.kind], "begin": take.begin,
            "band": np.array(take.band) if take.kind == "random" else None, "repeat_of": take.repeat_of,
        }
        for take in rig.takes
    }  # fmt: skip
    recording, answer = folder / f"{seed}.h5", folder / f"{seed}.json"
    write(recording, runs, records, inputs, converter, known, draw_)
    truth = {
        "seed": seed, "family": family, "rig": rig.name, "severity": severity, "soiled": soiled, "converter": converter,
        "rest": rest, "effects": told, "disturbances": disturbances,
        "change at full size": [{name: round(x, 4) for name, x in change.items()} for change in changes],
        "values": {f"bodies.{name}.mass": mass for name, mass in rig.bodies.items()}
        | {f"links.{x.name}.{y}": v for x in rig.links for y, v in (("stiffness", x.k), ("damping", x.c))}
        | {f"contacts.{x.name}.law.friction_force": x.force for x in rig.rubs} | {"drive.factor": rig.factor},
    }  # fmt: skip
    answer.write_text(json.dumps(truth, indent=1) + "\n")
    return recording, answer


def _inputs(rig: Rig, records: dict[str, dict[str, FloatArray]], draw_: Draw) -> dict[str, Input]:
    # Accelerometers of the wire bonder have one noise; other channels a share of the first run's signal.
    quantities = {rig.drive: rig.quantity, **{x.channel: x.quantity for x in rig.sensors}}
    noise = float(draw_.uniform(5e-4, 1.5e-3))
    first = records[rig.takes[0].id]
    inputs = {}
    for name, quantity in quantities.items():
        top = 1.2 * max(float(np.abs(found[name]).max()) for found in records.values())
        decade = 10.0 ** np.floor(np.log10(top))
        full = next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= top)
        own = noise if rig.name == "wire bonder" else float(np.std(first[name])) * (1e-4 if name == rig.drive else noise * 2.0)
        count = None
        if rig.counts and name != rig.drive:
            count, own = float(f"{top / rig.counts:.3g}"), 0.0
        inputs[name] = Input(quantity=quantity, noise=own, count=count, range=full)
    return inputs


def _known(rig: Rig, wrong: dict[str, float]) -> dict[str, float | str]:
    # What a lab knows of a wire bonder: weighed masses, and first guesses of frequencies.
    known: dict[str, float | str] = {
        "head_mass": rig.factor * wrong.get("drive.factor", 1.0), "table_mass": 250.0,
        **{f"{b}_mass": rig.bodies[b] * wrong.get(f"bodies.{b}.mass", 1.0) for b in ("motor", "heatblock")},
    }  # fmt: skip
    for body, link in (("table", "table"), ("heatblock", "heatblock"), ("motor", "isolation")):
        ratio = np.sqrt(rig.link(link).k / rig.bodies[body]) / (2 * np.pi)
        known[f"{body}_frequency"] = float(ratio * np.sqrt(wrong[f"links.{link}.stiffness"]))
    known["friction_force"] = rig.rubs[0].force * wrong["contacts.isolation.law.friction_force"]
    return known
