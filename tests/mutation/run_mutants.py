"""Which changes of the scoring and decision code do the tests notice? Each mutant is one change; a test that fails kills it.

    python tests/mutation/run_mutants.py --named      mutants that tests once let through, each by name
    python tests/mutation/run_mutants.py [FILE ...]   operators, numbers and bounds of these modules, else of all below

A mutant is run in a process of its own, forked after the libraries have been loaded; nothing on disk changes. Survivors that
docs/mutants.md does not list with a reason make the run fail.
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import importlib.abc
import importlib.machinery
import importlib.util
import io
import os
import re
import resource
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
VERDICT = (
    "tests/analysis/diagnose/test_thresholds.py",
    "tests/analysis/diagnose/test_policy.py",
    "tests/analysis/test_floors.py",
    "tests/analysis/test_scores.py",
)
STANDING = ("tests/analysis/diagnose/test_standing.py", "tests/analysis/diagnose/test_thresholds.py")
EQUATIONS = (
    "tests/analysis/equations/test_equation_parts.py", "tests/analysis/equations/test_repeats.py",
    "tests/analysis/diagnose/test_flat_tops.py", "tests/analysis/equations/test_equations.py",
    "tests/rig/test_slow_pulls.py::test_a_described_friction_law_starts_from_its_recorded_force",
)  # fmt: skip
TRENDS = ("tests/analysis/trends/test_trend_thresholds.py", "tests/analysis/trends/test_trends.py")
PROPOSALS = ("tests/analysis/proposals/test_proposal_thresholds.py", "tests/analysis/proposals/test_next_choice.py")


@dataclass(frozen=True)
class Covered:
    """How a module is mutated: the tests that take seconds, and the number of mutants that are drawn; all if None."""

    tests: tuple[str, ...]
    most: int | None = None


#: Modules that score and decide.
MODULES: dict[str, Covered] = {
    "isorig/analysis/fitting/excess.py": Covered(VERDICT),
    "isorig/analysis/diagnose/policy.py": Covered(VERDICT),
    "isorig/analysis/fitting/score.py": Covered(VERDICT),
    "isorig/drivers/order.py": Covered(("tests/drivers/test_order.py", "tests/drivers/test_framed.py")),
    "isorig/drivers/frames.py": Covered(("tests/drivers/test_frames.py", "tests/drivers/test_framed.py")),
    "isorig/analysis/units.py": Covered(("tests/analysis/test_units.py",)),
    "isorig/analysis/isolation/ratio.py": Covered(("tests/analysis/test_isolation.py",), 40),
    "isorig/rig/acquire/run_check.py": Covered(("tests/rig/acquire/test_check.py",)),
    "isorig/analysis/fitting/division.py": Covered(
        ("tests/analysis/test_division.py", "tests/analysis/test_fits.py::test_what_judges_is_kept_from_fits")
    ),
    "isorig/analysis/fitting/drive_noise.py": Covered(
        (
            "tests/analysis/test_drive_noise.py",
            "tests/analysis/test_characterize.py::test_intervals_hold_the_truth_with_other_noise_than_white",
        ),
        8,
    ),
    "isorig/analysis/trends/cusum.py": Covered(TRENDS, 40),
    "isorig/analysis/trends/policy.py": Covered(TRENDS),
    **{
        f"isorig/analysis/proposals/{name}.py": Covered(PROPOSALS, 10)
        for name in ("choice", "hypotheses", "limits", "menu", "policy", "precision", "prediction", "remedies")
    },
    **{
        f"isorig/analysis/diagnose/{name}.py": Covered(STANDING, 10) for name in ("considered", "revise", "step")
    },
    "isorig/analysis/diagnose/required_force.py": Covered(
        ("tests/blind/foreign/test_diagnosed.py",), 5
    ),
    **{
        f"isorig/analysis/fitting/{name}.py": Covered(
            ("tests/analysis/test_plausible.py", "tests/analysis/test_wrong_scale.py"), 10
        )
        for name in ("plausible", "wrong_scale")
    },
    **{
        f"isorig/analysis/equations/{name}.py": Covered(EQUATIONS, 5)
        for name in (
            "balances", "columns", "errors", "filters", "forms", "hidden", "known", "motion", "ranking", "repeats", "sliding",
            "slip", "spectral", "system",
        )
    },
}  # fmt: skip
#: Seed of the mutants that are drawn: the same ones in each run, so that survivors can be listed.
SEED = 1
#: Further tests of named mutants, by module.
OTHERS: dict[str, tuple[str, ...]] = {
    "isorig/rig/acquire/policy.py": ("tests/rig/acquire/test_check.py",),
    "isorig/analysis/diagnose/link_force.py": ("tests/analysis/diagnose/test_link_force.py",),
    **dict.fromkeys(
        (
            "isorig/analysis/equations/sliding.py", "isorig/analysis/fitting/held_out.py", "isorig/analysis/fitting/solve.py",
            "isorig/analysis/fitting/uncertainty.py", "isorig/analysis/spectra/noise.py", "isorig/analysis/spectra/overload.py",
        ),
        ("tests/analysis/test_boundaries.py",),
    ),
    "isorig/analysis/diagnose/search.py": ("tests/analysis/test_boundaries.py", *STANDING),
    "isorig/analysis/spectra/clocks.py": ("tests/analysis/test_clocks.py",),
}  # fmt: skip
#: Seconds of a processor, and of the clock, after which a mutant counts as noticed: it runs for ever, or waits.
TIMEOUT, WAITS = 120, 1200
#: Where survivors stand with the reason.
LISTED = ROOT / "docs" / "mutants.md"


@dataclass(frozen=True)
class Mutant:
    """A change of one module; `source` writes the changed text, `tests` may notice it."""

    file: str
    name: str
    source: Callable[[], str]
    tests: tuple[str, ...]


#: Changes that no test noticed once: what, where, the text and what it becomes.
NAMED = (
    (
        "'explained' from 0.4 of the excess", "isorig/analysis/diagnose/policy.py",
        "explained: float = 0.8", "explained: float = 0.4",
    ),
    ("adequate up to 2.5 floors", "isorig/analysis/fitting/excess.py", "ADEQUATE = 1.5", "ADEQUATE = 2.5"),
    ("a step is worth it from 0.02", "isorig/analysis/diagnose/policy.py", "worth: float = 0.15", "worth: float = 0.02"),
    ("certain from half of the draws", "isorig/analysis/diagnose/policy.py", "certain: float = 0.95", "certain: float = 0.5"),
    ("two draws of noise always suffice", "isorig/analysis/fitting/score.py", "SENSITIVE = 8, 1.3", "SENSITIVE = 8, 1e9"),
    ("blocks with ten times the noise", "isorig/analysis/fitting/score.py", "BLOCK_NOISE = 0.003", "BLOCK_NOISE = 0.03"),
    (
        "confidence is always 1", "isorig/analysis/fitting/score.py",
        "return float(np.mean(margin[:, picks].mean(axis=2).min(axis=0) > 0.0))", "return 1.0",
    ),
    (
        "the least simple of equals is carried", "isorig/analysis/diagnose/step.py",
        "return min(entries, key=lambda entry", "return max(entries, key=lambda entry",
    ),
    (
        "a sensor's fault need not explain its channel", "isorig/analysis/diagnose/policy.py",
        "    return left[0] - left[1] >= policy.worth * left[0]", "    return True",
    ),
    (
        "Hann segments are correlated by another number", "isorig/analysis/spectra/windows.py", "a * (1.0 - shift)",
        "a * (1.0 + shift)",
    ),
    (
        "a sign in the required drive", "isorig/analysis/simulate/inverse.py",
        "ends = [sign * resistance", "ends = [-sign * resistance",
    ),
    (
        "a plainly larger error is no other answer", "isorig/analysis/diagnose/policy.py",
        "    if adequate and not is_adequate(rival, floors, policy.distinguishable * policy.enough):\n        return False\n", "",
    ),
    (
        "samples may arrive fifty times as fast", "isorig/drivers/order.py",
        "SLACK, FASTER = 1.0, 2.0", "SLACK, FASTER = 1.0, 50.0",
    ),
    (
        "a clock agrees within ten times its resolution", "isorig/drivers/order.py", "LOOSE, EXACT = (2.0, 0.005)",
        "LOOSE, EXACT = (20.0, 0.05)",
    ),
    (
        "the sign of a link's force is always 1", "isorig/analysis/diagnose/link_force.py",
        "sign=1.0 if link.a in beyond else -1.0", "sign=1.0",
    ),
    ("neighbouring bins count as independent", "isorig/analysis/isolation/ratio.py", "TIED = 2.0", "TIED = 1.0"),
    ("a contact sticks below a fiftieth", "isorig/rig/acquire/policy.py", "STICKING = 0.2", "STICKING = 0.02"),
    ("a second of a run is its beginning", "isorig/analysis/fitting/division.py", "BEGINNING = 5.0", "BEGINNING = 1.0"),
    ("a Gal is ten times as large", "isorig/analysis/units.py", '"Gal": 0.01,', '"Gal": 0.1,'),
    (
        "an element that rests for half of the time is moved", "isorig/analysis/equations/sliding.py",
        "RESTS = 0.25", "RESTS = 0.5",
    ),
    (
        "a shape need explain only a tenth of a block", "isorig/analysis/equations/sliding.py",
        "EXPLAINED = 0.5", "EXPLAINED = 0.9",
    ),
    (
        "a run is calm at a tenth of its motion", "isorig/analysis/fitting/held_out.py",
        "CALM, FADED = 0.01, 1e-3", "CALM, FADED = 0.1, 1e-3",
    ),
    (
        "a motion lasts until a ten-thousandth", "isorig/analysis/fitting/held_out.py",
        "CALM, FADED = 0.01, 1e-3", "CALM, FADED = 0.01, 1e-4",
    ),
    (
        "a fit is lost at half of the signal", "isorig/analysis/diagnose/search.py",
        "LOST = (0.05 /", "LOST = (0.5 /",
    ),
    (
        "any form replaces a pair's curve", "isorig/analysis/diagnose/search.py",
        "POLICY.form_close**2 * both.cost", "1e9 * both.cost",
    ),
    (
        "eight equal samples are stuck in every channel", "isorig/analysis/spectra/overload.py",
        "LONGER = 8, 8.0", "LONGER = 8, 1.0",
    ),
    (
        "noise is that of half of the time", "isorig/analysis/spectra/noise.py",
        "UPPER, CALM, MOST = 0.77, 0.25, 0.9", "UPPER, CALM, MOST = 0.77, 0.5, 0.9",
    ),
    (
        "a fit is biased from a tenth on", "isorig/analysis/fitting/uncertainty.py",
        "BIASED = 0.02", "BIASED = 0.1",
    ),
    (
        "coarse derivatives that end a fit early", "isorig/analysis/fitting/solve.py",
        "before - linear <= tolerance * before)", "before - linear <= 10.0 * tolerance * before)",
    ),
    (
        "harmonics of a sine taken for a clock", "isorig/analysis/spectra/clocks.py",
        "DRIVEN = 1e-4", "DRIVEN = 1e-12",
    ),
    (
        "small causes searched for among the unseen", "isorig/analysis/diagnose/search.py",
        "UNSEEN if refuted and equations.complete", "UNSEEN if equations.complete",
    ),
)  # fmt: skip

COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}  # fmt: skip
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip
#: Numbers below this keep a division from zero.
GUARD = 1e-10
#: Calls whose arguments are left out: another seed (or default of a keyword, a number of draws) gives another sample of the same
#: distribution, and every negative length means the same to `reshape`.
UNCHANGED = ("default_rng", ".reshape")
NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any", "mean": "median"}


def mutants_of(file: str) -> Iterator[Mutant]:
    """Every mutant of a module, named by its function and what is changed; equal names are numbered from the second on."""
    named: Counter[str] = Counter()
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for where, node in _nodes(tree):
        for changed in _changes(node):
            if ast.unparse(changed) == ast.unparse(node):
                continue
            name = f"{where}: `{ast.unparse(node)}` -> `{ast.unparse(changed)}`"
            named[name] += 1
            name += f" ({named[name]})" if named[name] > 1 else ""
            yield Mutant(file, name, partial(_swapped, tree, node, changed), MODULES[file].tests)


def drawn(file: str) -> list[Mutant]:
    """The mutants of a module that are tried: all, or those drawn, in the order of the code."""
    made = list(mutants_of(file))
    # By a checksum of each name: a change of the module elsewhere leaves the others drawn as they were.
    drawn_first = sorted(range(len(made)), key=lambda k: sha256(f"{SEED} {made[k].name}".encode()).digest())
    return [made[k] for k in sorted(drawn_first[: MODULES[file].most])]


def _swapped(tree: ast.Module, old: ast.expr, new: ast.expr) -> str:
    copy = deepcopy(tree)
    _Swap(old, new).visit(copy)
    return ast.unparse(copy)


def _nodes(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    # Expressions that are run, each with the name of what holds it; annotations and keyword names are left out.
    def inside(node: ast.AST, where: str) -> Iterator[tuple[str, ast.expr]]:
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list", "slice"):
                continue
            if field == "kw_defaults" or (isinstance(node, ast.Call) and ast.unparse(node.func).endswith(UNCHANGED)):
                continue
            if isinstance(node, ast.keyword) and node.arg == "strict":
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.FunctionDef | ast.ClassDef):
                    yield from inside(child, child.name)
                elif isinstance(child, ast.AST):
                    if isinstance(child, ast.expr):
                        yield where, child
                    yield from inside(child, where)

    yield from inside(tree, "module")


def _changes(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        # A bound itself is tried between whole numbers only: errors never lie on one.
        whole = "len(" in ast.unparse(node) or any(isinstance(c, ast.Constant) and type(c.value) is int for c in node.comparators)
        for kind in COMPARED.get(type(node.ops[0]), ())[0 if whole else -1 :]:
            yield ast.Compare(left=node.left, ops=[kind()], comparators=node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield ast.BinOp(left=node.left, op=OPERATORS[type(node.op)](), right=node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(op=ast.And() if isinstance(node.op, ast.Or) else ast.Or(), values=node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not 0.0 < abs(node.value) < GUARD:
        yield ast.Constant(node.value + 1 if isinstance(node.value, int) or node.value == 0.0 else 2.0 * node.value)
    elif isinstance(node, ast.Name) and node.id in NAMES and hasattr(builtins, node.id):
        yield ast.Name(NAMES[node.id], ast.Load())
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield ast.Attribute(value=node.value, attr=NAMES[node.attr], ctx=ast.Load())


class _Swap(ast.NodeTransformer):
    # Exchanges one expression, found by its place in the text.
    def __init__(self, old: ast.expr, new: ast.expr) -> None:
        self._at = (type(old), old.lineno, old.col_offset, old.end_lineno, old.end_col_offset)
        self._new = new

    def visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.expr) and self._at == (
            type(node), node.lineno, node.col_offset, node.end_lineno, node.end_col_offset,
        ):  # fmt: skip
            return self._new
        return self.generic_visit(node)


class _Loader(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    # Gives the changed source in place of the file's.
    def __init__(self, mutant: Mutant) -> None:
        self._mutant, self._module = mutant, mutant.file.removesuffix(".py").replace("/", ".")

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._module:
            return None
        return importlib.util.spec_from_loader(fullname, self, origin=str(ROOT / self._mutant.file))

    def exec_module(self, module: ModuleType) -> None:
        module.__file__ = str(ROOT / self._mutant.file)
        exec(compile(self._mutant.source(), module.__file__, "exec"), module.__dict__)


def killer(mutant: Mutant) -> str:
    """The first test that fails with the change; empty where none does."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time()) + TIMEOUT, resource.RLIM_INFINITY))
        signal.alarm(WAITS)
        os.close(reading)
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            import pytest

            sys.meta_path.insert(0, _Loader(mutant))
            code = pytest.main(
                ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "--timeout=0", "-m", "not study", *mutant.tests]
            )
        found = re.search(r"^(?:FAILED|ERROR) (\S+)", text.getvalue(), re.MULTILINE)
        os.write(writing, (found[1] if found else "" if code == 0 else f"pytest ends with {int(code)}").encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as end:
        said = end.read().decode()
    _, status = os.waitpid(child, 0)
    return said if status == 0 else f"no answer within {TIMEOUT} s of a processor"


def named() -> list[Mutant]:
    """The mutants of `NAMED`."""
    found = []
    for name, file, old, new in NAMED:
        source = (ROOT / file).read_text(encoding="utf-8")
        if source.count(old) != 1:
            sys.exit(f"{file} has {source.count(old)} times the text {old!r}; correct the table NAMED")
        tests = OTHERS.get(file) or (MODULES[file].tests if file in MODULES else VERDICT)
        found.append(Mutant(file, name, partial(source.replace, old, new), tests))
    return found


def listed_survivors() -> list[str]:
    """File and name of each survivor that docs/mutants.md lists with a reason."""
    return re.findall(r"^\| (isorig/.*`(?: \(\d+\))?) \| ", LISTED.read_text(encoding="utf-8"), re.MULTILINE)


def main(arguments: Sequence[str]) -> int:
    """Run the mutants; status 1 where one survives that is not listed."""
    os.chdir(ROOT)
    by_name = "--named" in arguments
    files = [argument for argument in arguments if argument.endswith(".py")] or [*MODULES]
    chosen = named() if by_name else [m for file in files for m in drawn(file)]
    for library in ("hypothesis", "msgspec", "numba", "numpy", "pytest", "scipy.signal", "scipy.interpolate", "scipy.linalg"):
        importlib.import_module(library)
    listed = {*listed_survivors()}
    survivors, unlisted = [], []
    passing: set[tuple[str, ...]] = set()
    for k, mutant in enumerate(chosen):
        if mutant.tests not in passing:
            unchanged = Mutant(mutant.file, "unchanged", partial((ROOT / mutant.file).read_text, encoding="utf-8"), mutant.tests)
            if by := killer(unchanged):
                sys.exit(f"{mutant.file}: {by} without any change of the code; correct that test or the table of tests first")
            passing.add(mutant.tests)
        began = time.monotonic()
        by = killer(mutant)
        print(
            f"{k + 1}/{len(chosen)} {mutant.file} {mutant.name}: {by or 'SURVIVES'} ({time.monotonic() - began:.1f} s)",
            flush=True,
        )
        if not by:
            survivors.append(mutant)
            if by_name or f"{mutant.file} {mutant.name}" not in listed:
                unlisted.append(mutant)
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} mutants are noticed; {len(unlisted)} survivors are not listed")
    for mutant in unlisted:
        print(f"- {mutant.file} {mutant.name}")
    return 1 if unlisted else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
