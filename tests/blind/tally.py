"""Results of the study: rates with their intervals, and the confusion matrix as a table and a picture.

`python tests/blind/tally.py` writes docs/study.md and docs/pictures/study-*.png from docs/study/results.csv, with the rates of
the diagnosis before it had free shapes, from docs/study/results-forms-only.csv, for comparison.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).parent))

from decisions import sensitivity
from envelopes import CAUSES, OUTSIDE
from study import TABLE

from isorig.rig.wire_bonder.session import SESSION

DOCS = Path(__file__).parents[2] / "docs"
OTHER = DOCS / "study" / "other-rigs.csv"
EQUATIONS, FOREIGN = DOCS / "study" / "equations.csv", DOCS / "study" / "foreign.csv"
UNLIKE = DOCS / "study" / "unlike-bonders.csv"
INVESTIGATIONS, ELSEWHERE, PLANNED, EVERY_RUN = (
    DOCS / "study" / f"{name}.csv" for name in ("investigations", "investigations-other-rigs", "standard-plan", "every-run")
)
#: Measuring time in s of the standard plan of seven runs.
STANDARD = sum(take.seconds for take in SESSION)
PAGE, PICTURE = DOCS / "study.md", DOCS / "pictures" / "study-confusion.png"
#: Results of the diagnosis with catalogued forms only.
EARLIER = DOCS / "study" / "results-forms-only.csv"
#: Size classes by the ratio of the fitted baseline's held-out error to the noise floor.
CLASSES = (("full size (10 floors or more)", 10.0, np.inf), ("a third (3.3 to 10 floors)", 10 / 3, 10.0), ("less", 0.0, 10 / 3))


def rate(right: int, of: int) -> str:
    """Share with its 95 % interval (Wilson 1927)."""
    if of == 0:
        return "none yet"
    interval = binomtest(right, of).proportion_ci(method="wilson")
    return f"{right} of {of}: {100 * right / of:.1f} % ({100 * interval.low:.1f} to {100 * interval.high:.1f} %)"


def said(row: pd.Series) -> str:
    """The answer, as a column of the confusion matrix."""
    return str(row["named"]).split("+")[0].split(" at ")[0] if row["named"] else str(row["verdict"])


def confusion(table: pd.DataFrame) -> pd.DataFrame:
    """Counts by hidden effect (rows) and first name given (columns)."""
    kinds = [k for k in ("none", *CAUSES, "two", *(f"outside: {o}" for o in OUTSIDE)) if (table["kind"] == k).any()]
    counts = pd.crosstab(table["kind"], table.apply(said, axis=1))
    columns = [c for c in (*CAUSES, "unexplained", "adequate") if c in counts.columns]
    return counts.loc[kinds, columns]


def draw(counts: pd.DataFrame, target: Path) -> None:
    """Draw the matrix."""
    figure = Figure(figsize=(10.0, 8.5), layout="constrained")
    axes = figure.add_subplot()
    share = counts.div(counts.sum(axis=1), axis=0)
    axes.imshow(share.to_numpy(), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i in range(counts.shape[0]):
        for j in range(counts.shape[1]):
            if counts.iat[i, j]:
                colour = "white" if share.iat[i, j] > 0.5 else "black"
                axes.text(j, i, str(counts.iat[i, j]), ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(counts.shape[1]), [c.replace("_", " ") for c in counts.columns], rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(counts.shape[0]), [k.replace("_", " ") for k in counts.index], fontsize=8)
    axes.set(xlabel="first name given, or the verdict", ylabel="hidden in the recording")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)


def markdown(rows: list[tuple[str, ...]], head: tuple[str, ...]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def rates(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """The main rates of the study."""
    hidden = table[table["kind"].isin([*CAUSES, "two"])]
    above = hidden["baseline"] / hidden["floor"]
    none, outside = table[table["kind"] == "none"], table[table["kind"].str.startswith("outside")]
    named, two = table[table["named"] != ""], table[table["kind"] == "two"]
    gained = hidden[hidden["verdict"] == "explained"]
    # Later runs have other gains and therefore another noise floor: an error below this campaign's floor counts as fully removed.
    removed = (gained["later_baseline"] - gained["later_extended"]) / (gained["later_baseline"] - gained["floor"])
    removed = removed.clip(upper=1.0)
    found = []
    for name, low, high in CLASSES:
        part = hidden[(above >= low) & (above < high)]
        found.append((f"right cause and place, {name}", rate(int(part["right"].sum()), len(part))))
    found += [
        ("right if a cause is named", rate(int(named["right"].sum()), len(named))),
        ("cause named without an effect (false alarm)", rate(int((none["named"] != "").sum()), len(none))),
        ("no effect, verdict adequate", rate(int((none["verdict"] == "adequate").sum()), len(none))),
        ("cause outside the catalogue, no name given", rate(int((outside["named"] == "").sum()), len(outside))),
        (
            "cause outside the catalogue, verdict unexplained",
            rate(int((outside["verdict"] == "unexplained").sum()), len(outside)),
        ),
        ("two causes at once, both named", rate(int((two["named"].str.count(" at ") >= 2).sum()), len(two))),
        (
            "share of the explainable error removed on later runs",
            f"median {100 * removed.median():.1f} % over {len(removed)} campaigns" if len(removed) else "none yet",
        ),
    ]
    return found


def causes(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """One row for each kind."""
    rows = []
    for kind, part in table.groupby("kind", sort=False):
        above = part["baseline"] / part["floor"]
        rows.append(
            (
                str(kind).replace("_", " "),
                *(
                    f"{int(p['right'].sum())} of {len(p)}"
                    for _, low, high in CLASSES
                    for p in [part[(above >= low) & (above < high)]]
                ),
            )
        )
    return sorted(rows)


def other_rigs(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """Answers on rigs that no model describes exactly, by hidden effect."""
    groups = {
        "no effect": table["kind"] == "none",
        "a catalogued form": table["kind"].isin(CATALOGUED),
        "a form outside the catalogue": ~table["kind"].isin({"none", "two"} | CATALOGUED),
        "two causes": table["kind"] == "two",
    }
    rows = []
    for name, chosen in groups.items():
        for soil, dirt in ((0.0, "clean"), (0.02, "with 2 % of disturbances")):
            part = table[chosen & (table["soil"] == soil)]
            answers = part["answer"].value_counts()
            near = int(answers.get("right", 0) + answers.get("kind", 0))
            counts = (
                rate(near, len(part)),
                *(str(answers.get(word, 0)) for word in ("right", "kind", "part", "silent", "disturbance", "wrong")),
            )
            rows.append((f"{name}, {dirt}", *counts))
    return rows


#: Kinds that are hidden with a cause of the catalogue.
CATALOGUED = {*CAUSES, "coulomb_friction", "stop that damps"}
ENVELOPE = ["kind", "size", "seed"]


def investigation_groups(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """The envelopes of investigations by hidden effect."""
    caused, none = table["kind"].isin(CATALOGUED), table["kind"] == "none"
    return [
        ("catalogued cause, full size", table[caused & (table["size"] == 1.0)]),
        ("catalogued cause, a third of full size", table[caused & (table["size"] < 1.0)]),
        ("a form outside the catalogue (right: no name, or place and kind)", table[~caused & ~none]),
        ("no effect", table[none]),
    ]


def shapeless(named: str) -> bool:
    """Whether all names are forms of the catalogue."""
    return all(name.split(" at ")[0] in CAUSES for name in named.split("+") if name)


def investigations(found: pd.DataFrame, standard: pd.DataFrame) -> list[tuple[str, ...]]:
    """Investigations and the standard plan on the same envelopes, by hidden effect."""
    proposed = found[found["way"] == "proposed"]
    both = proposed.merge(standard, on=ENVELOPE, suffixes=("", "_standard"))
    rows = []
    for (name, own), (_, shared) in zip(investigation_groups(proposed), investigation_groups(both), strict=True):
        if len(own):
            seconds = own["seconds"].astype(float)
            forms = own["named"].map(shapeless) & (own["right"] == 1)
            rows.append(
                (
                    name, rate(int(own["right"].sum()), len(own)), str(int(forms.sum())),
                    f"{int(shared['right'].sum())} and {int(shared['right_standard'].sum())} of {len(shared)}",
                    f"{seconds.median():g} s ({seconds.min():g} to {seconds.max():g} s)",
                )
            )  # fmt: skip
    return rows


def further_runs(found: pd.DataFrame) -> list[tuple[str, ...]]:
    """Number of further runs until only the right cause remains, for proposals and for other choices of the next run."""
    shared = set.intersection(*(set(found[found["way"] == way]["seed"]) for way in ("proposed", "repeat", "random")))
    rows = []
    words = {"proposed": "proposed by the program", "repeat": "the last run repeated", "random": "an allowed run at random"}
    for way, text in words.items():
        part = found[(found["way"] == way) & found["seed"].isin(shared)]
        done = (part["right"] == 1) & (part["open"] == "")
        needed = np.where(done, part["further"], np.inf)
        # The lower of two middle values: half of the investigations needed no more runs.
        middle = float(np.quantile(needed, 0.5, method="lower")) if len(needed) else np.nan
        most = "more than twice those proposed" if np.isinf(middle) else f"{middle:g}"
        rows.append((text, f"{int(done.sum())} of {len(part)}", most, f"{int(part['further'].sum())}"))
    return rows


def pairs_parted(found: pd.DataFrame, standard: pd.DataFrame) -> str:
    """Result of investigations for causes that the standard plan cannot distinguish."""
    proposed = found[found["way"] == "proposed"]
    both = proposed.merge(standard, on=ENVELOPE, suffixes=("", "_standard"))
    alike = both[both["alike"] != ""]
    parted = int((alike["open"] == "").sum())
    said = int(alike["ended"].str.contains("No allowed run|same equations").sum())
    begun = proposed[proposed["first_open"] != ""]
    ended, named = begun[begun["open"] == ""], begun["ended"].str.contains("No allowed run|same equations")
    return (
        f"The standard plan left indistinguishable causes in {len(alike)} of {len(both)} envelopes; investigations distinguished "
        f"{parted} of these and reported for {said} that no allowed run does.\nAfter the first stage {len(begun)} of "
        f"{len(proposed)} investigations had several possible causes: {len(ended)} ended with one, {int(named.sum())} with the\n"
        "statement that no allowed run distinguishes them."
    )


def _compared(found: pd.DataFrame) -> str:
    if not (found["way"] == "repeat").any():
        return "Proposals have not been compared with repeated or random runs yet."
    head = ("next run", "right cause alone", "median of further runs", "total of further runs")
    return f"""Investigations that needed further runs were repeated from the first stage, with up to twice as many runs:

{markdown(further_runs(found), head)}"""


def investigation_section(found: pd.DataFrame, standard: pd.DataFrame) -> str:
    """The part of the page on investigations."""
    proposed = found[found["way"] == "proposed"]
    times = proposed["proposal"].astype(float)
    head = (
        "hidden",
        "right (95 % interval)",
        "without a free shape",
        "right on the same envelopes, and standard plan",
        "median measuring time",
    )
    share = proposed["seconds"].astype(float).median() / STANDARD
    known = set(proposed["kind"])
    missing = [kind.replace("_", " ") for kind in ("none", *CAUSES, *(f"outside: {o}" for o in OUTSIDE)) if kind not in known]
    return f"""
## Investigations

{len(proposed)} sealed rigs ({seeds_of(proposed)}) were investigated without earlier runs by `tests/blind/investigation_study.py`,
as by `rig investigate`: the rig runs the proposed drives, and the hidden effect is disclosed after the last answer.
The standard plan is the session of seven runs, {STANDARD:g} s of measuring. Every investigation has a line in
`docs/study/investigations.csv`, the standard plan on the same rigs one in `docs/study/standard-plan.csv`. An answer is right if
every named cause, or one that it reports as indistinguishable from it, was hidden at the named place; a free shape is right if a
cause of its kind was hidden there.

{markdown(investigations(found, standard), head)}

The median measuring time of all investigations is {100 * share:.0f} % of that of the standard plan.
A limit was exceeded in {int((found["broken"] != "").sum())} of {len(found)} investigations. A proposal
took {times.median():.0f} s in the median, and at most {times.max():.0f} s. A rig with a catalogued effect for
which no cause is named counts as wrong.

Not investigated yet: {", ".join(missing) or "nothing"}.

{_compared(found)}

{pairs_parted(found, standard)}
{every_run()}{elsewhere()}"""


def elsewhere() -> str:
    """Investigations of other rigs; empty if there are none."""
    if not ELSEWHERE.exists():
        return ""
    found = pd.read_csv(ELSEWHERE, keep_default_na=False)
    proposed = found[found["way"] == "proposed"]
    nothing = proposed.iloc[:0].assign(alike="")
    rows = [(name, right, forms, seconds) for name, right, forms, _, seconds in investigations(found, nothing)]
    head = ("hidden", "right (95 % interval)", "without a free shape", "median measuring time")
    return f"""
The same was done with {len(proposed)} chains, pairs of carts and stages ({seeds_of(proposed)}), whose descriptions have values up
to a quarter off (`--rigs others`, `docs/study/investigations-other-rigs.csv`). A limit was exceeded in
{int((found["broken"] != "").sum())} of {len(found)} investigations.

{markdown(rows, head)}

{_compared(found)}
"""


def every_run() -> str:
    """Whether an allowed run distinguishes causes of which a proposal said that none does; empty if it was not tried."""
    if not EVERY_RUN.exists():
        return ""
    table = pd.read_csv(EVERY_RUN, keep_default_na=False)
    return (
        f"\nTo check {len(table)} of these statements every allowed candidate run was taken and diagnosed together with the\n"
        f"earlier runs (`tests/blind/every_run.py`, {int(table['candidates'].sum())} runs): "
        f"in {int((table['single'] == 0).sum())} of {len(table)} none of them left a single cause.\n"
    )


def seeds_of(table: pd.DataFrame) -> str:
    """First and last seed."""
    return f"seeds {table['seed'].min()} to {table['seed'].max()}"


def sensitivity_section() -> str:
    """Effect of other thresholds on the verdicts; empty if no campaign has been evaluated."""
    count, rows = sensitivity((TABLE, OTHER))
    if not count:
        return ""
    head = ("threshold", "value", "half: rules, answers", "double: rules, answers")
    cells = [(f"`{name}`", value, f"{half[0]}, {half[1]}", f"{double[0]}, {double[1]}") for name, value, half, double in rows]
    return f"""
## Sensitivity to the thresholds

The rules of `analysis/diagnose/policy.py` depend on errors only. The study stores the inputs of each rule and evaluates the rules
again with other thresholds. The table gives, of {count} campaigns, the number in which any rule decides differently, and the
number in which the verdict or the number of causes changes, with half and with double the threshold. For thresholds near one,
their difference to one is halved and doubled; for ratios, their excess over one. The table does not include thresholds that
control the search itself.

{markdown(cells, head)}
"""


def equations_section() -> str:
    """Place and kind by the equations of motion alone, counted by `foreign/ranked.py`."""
    if not EQUATIONS.exists():
        return ""
    table = pd.read_csv(EQUATIONS)
    outcomes = ("first", "suspected", "wrong", "silent", "said")
    rows = [(group, *(str((own["outcome"] == name).sum()) for name in outcomes)) for group, own in table.groupby("group")]
    wrong = "; ".join(
        f"{one.best} for {one.hidden or 'a sound rig'} (seed {one.seed}, {one.family})"
        for one in table[table["outcome"] == "wrong"].fillna("").itertuples()
    )
    return f"""
## Place and kind by the equations of motion alone

{len(table)} campaigns ({seeds_of(table)}) of wire bonders, chains, carts with encoders, stages, torsion drives, shaken bases and
partly measured chains, simulated by another program behind converters with sharp filters, with descriptions up to a quarter off.
Nothing was simulated by the project: the explanations of each campaign were ranked by the residuals of its equations. The right
place and kind is the best explanation ("first"), among the best three ("suspected"), or not although one shows clearly ("wrong");
of two causes, one suffices. "silent" means that none shows clearly, "said" that a disturbance that is in the rig is the best one.
Every campaign has a line in `docs/study/equations.csv`, written by
`python tests/blind/foreign/ranked.py --seeds {table["seed"].min()}-{table["seed"].max()} --csv docs/study/equations.csv`.

{markdown(rows, ("hidden", *outcomes))}

Wrong: {wrong or "none"}.
"""


def foreign_section(table: pd.DataFrame) -> str:
    """Whole diagnoses of foreign rigs, counted by `foreign/diagnosed.py`."""
    rows = []
    for group, own in table.groupby("group"):
        count = own["outcome"].value_counts()
        others = (str(count.get(name, 0)) for name in ("disturbance", "one of two", "no name", "wrong"))
        rows.append((str(group), rate(int(count.get("right", 0)), len(own)), *others))
    families = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in table["family"].value_counts().items())
    wrong = "; ".join(
        f"{one.named} for {one.hidden or 'a sound rig'} (seed {one.seed}, {one.family})"
        for one in table[table["outcome"] == "wrong"].itertuples()
    )
    return f"""
## Rigs of another program

{len(table)} campaigns ({seeds_of(table)}) of rigs that `tests/blind/foreign/` simulates by a program of its own, behind
converters with sharp filters and with descriptions up to a quarter off ({families}). They hide a cause of the catalogue, a
form outside it, two causes or none. An answer is right if it names the place and kind of every cause and nothing else; a sound
rig must be adequate. A disturbance that is in the rig, named instead, counts apart. A diagnosis
takes {table["processor_s"].median():.0f} s of processor in the median, {table["processor_s"].max():.0f} s at most.
One version of the program diagnosed all of them. Every campaign has a line in `docs/study/foreign.csv`, written by
`python tests/blind/foreign/diagnosed.py --seeds {table["seed"].min()}-{table["seed"].max()} --csv docs/study/foreign.csv`.

{markdown(rows, ("hidden", "right", "only a disturbance", "one of two", "no name", "wrong name"))}

Wrong: {wrong or "none"}.
"""


def main() -> None:
    earlier = pd.read_csv(EARLIER, keep_default_na=False)
    table = pd.read_csv(TABLE, keep_default_na=False) if TABLE.exists() else earlier.iloc[:0]
    counts = confusion(table if len(table) else earlier)
    draw(counts, PICTURE)
    seeds = f" ({seeds_of(table)})" if len(table) else ""
    others = pd.read_csv(OTHER, keep_default_na=False) if OTHER.exists() else None
    section = ""
    head = (
        "hidden",
        "place and kind right",
        "form right too",
        "kind only",
        "one of two",
        "no name",
        "only a disturbance",
        "wrong name",
    )
    if others is not None:
        section = f"""
## Other rigs

{len(others)} campaigns ({seeds_of(others)}) of driven chains, two carts with a voltage, and a stage with position and
acceleration, drawn as above by `tests/blind/study_other.py`: with forms outside the catalogue, with 2 % of every signal from
loose parts, floor vibration and nonlinear sensors, and a third of them with rest before the drive. Every campaign has a
line in `docs/study/other-rigs.csv`.

{markdown(other_rigs(others), head)}
"""
    if UNLIKE.exists():
        unlike = pd.read_csv(UNLIKE, keep_default_na=False)
        section += f"""
## Wire bonders that no model describes exactly

{len(unlike)} campaigns ({seeds_of(unlike)}) of wire bonders, drawn by `tests/blind/study_other.py --rigs bonders`: seven runs,
320 s, one drive repeated; with forms outside the catalogue, with 2 % of every signal from loose parts, uneven friction, floor
vibration and nonlinear sensors, and a third of them with rest before the drive. Every campaign has a line in
`docs/study/unlike-bonders.csv`.

{markdown(other_rigs(unlike), head)}
"""
    if INVESTIGATIONS.exists():
        section += investigation_section(*(pd.read_csv(path, keep_default_na=False) for path in (INVESTIGATIONS, PLANNED)))
    if FOREIGN.exists():
        section += foreign_section(pd.read_csv(FOREIGN, keep_default_na=False))
    section += equations_section() + sensitivity_section()
    count = f"{len(table)} campaigns{seeds}" if len(table) else "For this version no campaigns"
    drawn = f"{count} of the wire bonder's long session were drawn blind"
    rated = markdown(rates(table), ("what", "rate (95 % interval)")) + "\n" if len(table) else ""
    text = f"""# Accuracy of the diagnosis

{drawn};
those of other rigs and of imperfect wire bonders are below. Each has another rig with an effect of random size, no effect, or an
effect outside the catalogue. The virtual rig was recorded, `rig diagnose` answered from the recording alone, and the effect was
disclosed afterwards. An answer is right if every named cause, or one that it reports as indistinguishable from it, was hidden at
the named place. All intervals are 95 % intervals. `make study` draws further campaigns and rewrites this page; every campaign
has a line in a table of the folder `docs/study`.

{rated}{section}
## Before free shapes

The earlier diagnosis with catalogued forms only was evaluated on {len(earlier)} campaigns (seeds {earlier["seed"].min()} to
{earlier["seed"].max()}; `docs/study/results-forms-only.csv`). These rates do not apply to the present version. The
picture and the table below are from the same campaigns until the present version has been evaluated.

{markdown(rates(earlier), ("what", "rate (95 % interval)"))}

![Confusion matrix](pictures/{PICTURE.name})

Right answers by kind and by the ratio of the fitted baseline's held-out error to the noise floor. If there is no hidden effect,
or one outside the catalogue, an answer without a name is right:

{markdown(causes(table if len(table) else earlier), ("hidden", *(name for name, _, _ in CLASSES)))}
"""
    PAGE.write_text(text)
    print(f"{PAGE}: {len(table)} campaigns")


if __name__ == "__main__":
    main()
