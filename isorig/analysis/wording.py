"""Words for messages: shares, factors, a value in a unit of its size, the name that was probably meant."""

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher

import numpy as np

#: From this share on a size is given as a multiple, and from this factor on a difference as a factor: more digits of per cent say
#: no more than two digits of these.
MULTIPLE, FACTOR = 10.0, 1.9
#: Size from which a value without its uncertainty has an exponent. Chosen: a reader counts no more zeros.
WRITTEN_OUT = 1e6
#: Units by size, largest first: (smallest SI value that is written in it, its SI value, its name).
SIZED: dict[str, tuple[tuple[float, float, str], ...]] = {
    "m": ((1.0, 1.0, "m"), (1e-4, 1e-3, "mm"), (1e-7, 1e-6, "µm"), (0.0, 1e-9, "nm")),
    "m/s": ((1.0, 1.0, "m/s"), (1e-4, 1e-3, "mm/s"), (0.0, 1e-6, "µm/s")),
    "s": ((1.0, 1.0, "s"), (1e-4, 1e-3, "ms"), (0.0, 1e-6, "µs")),
    "rad": ((1.0, 1.0, "rad"), (1e-4, 1e-3, "mrad"), (0.0, 1e-6, "µrad")),
    "N": ((1e3, 1e3, "kN"), (0.1, 1.0, "N"), (0.0, 1e-3, "mN")),
    "N m": ((1e3, 1e3, "kN m"), (0.1, 1.0, "N m"), (0.0, 1e-3, "mN m")),
    "kg": ((0.1, 1.0, "kg"), (0.0, 1e-3, "g")),
    "Hz": ((1e3, 1e3, "kHz"), (0.0, 1.0, "Hz")),
    "N/m": ((1e3, 1e3, "kN/m"), (0.0, 1.0, "N/m")),
    "N m/rad": ((1e3, 1e3, "kN m/rad"), (0.0, 1.0, "N m/rad")),
    "N/m^3": ((1e8, 1e9, "N/mm³"), (1e6, 1e6, "MN/m³"), (1e3, 1e3, "kN/m³"), (0.0, 1.0, "N/m³")),
    "1": ((1.0, 1.0, ""), (0.0, 1e-2, "%")),
}
#: Most significant digits of a written value: a smaller uncertainty than these is no reason for more.
MOST_DIGITS = 6
#: Power of ten below which a value is written with an exponent.
LEAST_ORDER = -3
#: Likeness of two names from which one is proposed for the other: twice the number of common letters over all letters. Default of
#: `difflib.get_close_matches`.
SIMILAR = 0.6
#: Names of up to this many letters are no words.
INITIALS = 2


def of_signal(share: float) -> str:
    """An error as a share of the signal, to two significant digits.

    Examples
    --------
    >>> of_signal(0.0312), of_signal(642729.08)
    ('3.1 % of the signal', '6.4e+05 times the signal')
    """
    if share >= MULTIPLE:
        return f"{share:.2g} times the signal"
    return f"{float(f'{100.0 * share:.2g}'):g} % of the signal"


def in_per_cent(share: float) -> str:
    """A share to two digits, in per cent; a multiple of the signal if it is larger.

    Examples
    --------
    >>> in_per_cent(0.004), in_per_cent(0.349), in_per_cent(12.3)
    ('0.40 %', '35 %', '12 times the signal')
    """
    if share >= MULTIPLE:
        return f"{share:.2g} times the signal"
    return f"{100.0 * share:.0f} %" if share >= 0.0995 else f"{100.0 * share:#.2g} %"


def fall(before: float, after: float) -> str:
    """How a cause changes the median error over runs and channels: "falls from 5 % to 1 %"."""
    first, last = in_per_cent(before), in_per_cent(after)
    if first == last:
        return f"stays at {first} in the median over runs and channels, and falls where the cause acts"
    return f"falls from {first} to {last}"


def as_difference(share: float) -> str:
    """A relative difference to two digits, in per cent; as a factor if it is larger.

    Examples
    --------
    >>> as_difference(0.043), as_difference(584.0)
    ('4.3 %', 'a factor of 580')
    """
    return f"a factor of {float(f'{share:.2g}'):g}" if share >= MULTIPLE else f"{100.0 * share:.2g} %"


def noise_alone(floor: float) -> str:
    """A noise floor, a share of the signal, in the words of every command.

    It is an estimate and no bound: a cause that the model lacks may amplify the drive's noise or damp it, and what is left of the
    motion in the records from which the sensors' noise is estimated may raise it above the error of the model.

    Examples
    --------
    >>> noise_alone(0.0042)
    'about 0.42 %'
    """
    return f"about {in_per_cent(floor)}"


def by_factor(log_ratio: float) -> str:
    """The difference of two positive values from the logarithm of their ratio, of either sign.

    Examples
    --------
    >>> by_factor(0.0488), by_factor(-13.4)
    ('5 %', 'a factor of 6.6e+05')
    """
    factor = float(np.exp(abs(log_ratio)))
    return f"a factor of {factor:.2g}" if factor >= FACTOR else f"{100.0 * (factor - 1.0):.2g} %"


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """ " (did you mean 'x'?)" for the most similar allowed name, of several the first; "" if none is similar.

    The words that two names do not share must be similar: equal numbers, units or groups do not make names similar.

    Examples
    --------
    >>> did_you_mean("stifness", ("stiffness", "damping")), did_you_mean("mass", ("stiffness", "damping"))
    (" (did you mean 'stiffness'?)", '')
    >>> did_you_mean("Force 1 [N]", ("Acc 1 [g]", "Acc 2 [g]")), did_you_mean("Force 1", ("Force 01", "Force 11"))
    ('', " (did you mean 'Force 01'?)")
    """
    likeness = {each: min(_likeness(name.lower(), each.lower()), _words_alike(name, each)) for each in allowed}
    best = max(likeness, key=likeness.__getitem__, default="")
    return f" (did you mean {best!r}?)" if best and likeness[best] >= SIMILAR else ""


def _likeness(one: str, other: str) -> float:
    return 1.0 if one == other else SequenceMatcher(None, one, other).ratio()


def _words_alike(one: str, other: str) -> float:
    # The likeness of the words that only one of them has; a word may be abbreviated.
    first, second = (re.findall("[^\\W\\d_]+", name.lower()) for name in (one, other))
    mine, others = ("".join(word for word in a if word not in b) for a, b in ((first, second), (second, first)))
    return 1.0 if mine.startswith(others) or others.startswith(mine) else _likeness(mine, others)


def first_of(names: Sequence[str], most: int) -> str:
    """The first names of a list, and the number of the others.

    Examples
    --------
    >>> first_of(["a", "b", "c", "d"], 2), first_of(["a", "b"], 2)
    ('a, b, and 2 more', 'a, b')
    """
    return ", ".join(names[:most]) + (f", and {len(names) - most} more" if len(names) > most else "")


def capitalized(text: str) -> str:
    """The text with a capital first letter; units and names keep theirs.

    Examples
    --------
    >>> capitalized("random drive from 1 to 40 Hz")
    'Random drive from 1 to 40 Hz'
    """
    return text[:1].upper() + text[1:]


def words(name: str) -> str:
    """A name for display: underscores become spaces."""
    return name.replace("_", " ")


def with_article(name: str) -> str:
    """The name of a place or channel in a sentence; one with a digit or a capital, or of one or two letters, needs no article.

    Examples
    --------
    >>> with_article("heat_block"), with_article("l2"), with_article("a"), with_article("ACC_z")
    ('the heat block', 'l2', 'a', 'ACC z')
    """
    plain = words(name)
    proper = len(name) <= INITIALS or any(letter.isdigit() or letter.isupper() for letter in name)
    return plain if proper else f"the {plain}"


def state(configuration: str, gain: float, alone: bool = False) -> str:
    """Configuration and gain; the gain only of a rig that has one configuration, whose name says nothing.

    Examples
    --------
    >>> state("locked", 7.0), state("unlocked", 7.0, alone=True)
    ('locked at gain 7', 'at gain 7')
    """
    return f"at gain {gain:g}" if alone else f"{configuration} at gain {gain:g}"


def sized(value: float, unit: str, std: float | None = None, digits: int = 3) -> str:
    """A value in a unit of its size, to the digits that its standard uncertainty justifies.

    Parameters
    ----------
    value, unit
        The value in an SI unit; units without sizes in `SIZED` are kept.
    std
        Its standard uncertainty; None or zero for a value without one, which gets `digits` significant digits.
    digits
        Significant digits without an uncertainty.

    Examples
    --------
    >>> sized(0.0005, "m", 3e-7), sized(2871.5, "N/m", 60.0), sized(0.0005, "m")
    ('0.5000 ± 0.0003 mm', '2.87 ± 0.06 kN/m', '0.5 mm')
    >>> sized(0.795, "1", 0.001), sized(4.2, "N s/m"), sized(3182.0, "N s/m"), sized(1.783e6, "N/m", 5e8)
    ('79.50 ± 0.10 %', '4.2 N s/m', '3180 N s/m', '1800 ± 500000 kN/m')
    """
    scale, name = sized_unit(value or std or 0.0, unit)
    of = f" {name}" if name else ""
    number = value / scale
    if not std or not np.isfinite(std):
        text = f"{number:.{digits}g}"
        return f"{float(text):.0f}{of}" if "e+" in text and abs(number) < WRITTEN_OUT else f"{text}{of}"
    return f"{with_std(number, std / scale, digits)}{of}"


def with_std(value: float, std: float, digits: int = 3, *, sign: bool = False) -> str:
    """A value and its standard uncertainty, to the digits that this justifies.

    Parameters
    ----------
    value, std
        Both in the same unit.
    digits
        Significant digits of a value whose uncertainty is zero or not finite, or that is far from one.
    sign
        Whether a positive value has a sign, as that of a change.

    Examples
    --------
    >>> with_std(54.7, 12.3), with_std(0.01841, 0.0061), with_std(7.25, 0.0)
    ('55 ± 12', '0.018 ± 0.006', '7.25 ± 0')
    """
    plus = "+" if sign else ""
    if not 0.0 < std < np.inf:
        return f"{value:{plus}.{digits}g} ± {std:.{digits}g}"
    # One digit of the uncertainty; two if it begins with a one, where rounding would change it by half.
    first = int(np.floor(np.log10(std)))
    places = -first + (1 if std / 10.0**first < 2.0 else 0)
    order = int(np.floor(np.log10(abs(value)))) if value else first
    if not LEAST_ORDER <= order < MOST_DIGITS:
        return f"{value:{plus}.{digits}g} ± {std:.1g}"
    # An uncertainty above the value must not round it to zero: it keeps two digits.
    shown = min(places, MOST_DIGITS - 1 - order) if places >= -order else 1 - order
    # One far below the digits of the value would be a row of zeros.
    spread = f"{std:.1g}" if shown < places - 1 else f"{round(std, places):.{max(places, 0)}f}"
    return f"{round(value, shown):{plus}.{max(shown, 0)}f} ± {spread}"


def displayed_unit(unit: str) -> str:
    """A unit as in texts and on axes."""
    return unit.replace("^2", "²").replace("^3", "³")


def unit_ratio(response: str, reference: str) -> str:
    """The unit of a response divided by a reference, as in texts and on axes."""
    return " per ".join(displayed_unit(unit) or "unknown unit" for unit in (response, reference))


def sized_unit(value: float, unit: str) -> tuple[float, str]:
    """SI value and name of the unit in which a value of an SI unit is written; zero is in the SI unit."""
    sizes = SIZED.get(unit)
    if sizes is None:
        return 1.0, displayed_unit(unit)
    if not value:
        return next((scale, name) for _, scale, name in sizes if scale == 1.0)
    return next((scale, name) for least, scale, name in sizes if abs(value) >= least)
