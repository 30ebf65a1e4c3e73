"""The architecture, as in the imports and the tree: what stands on which floor, and that nothing goes in circles.

A circle is found wherever it is, so floors name only what a circle would not show: what may never know of what.
"""

import ast
import re
from pathlib import Path

import imports_of
import pytest

import blurnoise

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "blurnoise": ROOT / "blurnoise",
    "blurnoise_eval": ROOT / "eval" / "blurnoise_eval",
    "blurnoise_models": ROOT / "models" / "blurnoise_models",
}
TESTS = {"blurnoise": "blurnoise", "eval": "blurnoise_eval", "models": "blurnoise_models"}
"""Folder of the tests to the package that it mirrors."""
OF_THE_WHOLE_TREE = {
    "test_architecture.py",
    "test_frozen.py",
    "test_documentation.py",
    "test_doctests.py",
}
"""Tests that belong to no package, in tests/ itself."""
LONGEST_LINES = 450
MOST_PARAMETERS = 10
WITH_MORE_PARAMETERS = {
    "blurnoise.scene.simulate.simulate",  # a keyword for each condition, for those who know no record yet
}
"""Functions that may have more; commands may, too: their parameters are the arguments and options of the command."""

FLOORS: dict[str, list[set[str]]] = {
    "blurnoise": [
        {"_core", "charts", "metrics"},
        {"camera"},
        {"motion"},
        {"blur"},
        {"light"},
        {"sensor", "picture"},
        {"scene"},
        {"training"},
    ],
    "blurnoise.metrics": [{"values"}, {"edge", "patches"}, {"information"}],
    "blurnoise_eval": [
        {"system", "plan", "detectors"},
        {"datasets"},
        {"store"},
        {"scoring"},
        {"answers", "contracts"},
        {"plots"},
        {"report"},
        {"run"},
        {"program"},
        {"calibration", "simulation"},
        {"measure"},
        {"explorer"},
        {"cli"},
        {"bench"},
    ],
    "blurnoise_eval.detectors": [
        {"records", "contract"},
        {"model"},
        {"formats"},
        {"contract_files", "recognition"},
        {"detector", "ocr"},
        {"opening"},
    ],
    "blurnoise_models": [{"scenes", "network"}, {"training", "export"}, {"detector"}],
}
"""Folder to what stands in it, floor by floor: none imports from a floor above its own. What is not named stands
where it likes, as long as it makes no circle; folders directly in a package have to be named."""

ALLOWED_ACROSS = {"blurnoise": set(), "blurnoise_eval": {"blurnoise"}, "blurnoise_models": {"blurnoise"}}
EXCEPTIONS = {  # they offer the built-in detector, make it, or draw its scenes
    ("blurnoise_eval.cli", "blurnoise_models"),
    ("blurnoise_eval.run", "blurnoise_models"),
    ("blurnoise_eval.bench", "blurnoise_models"),
    ("blurnoise_eval.scenes", "blurnoise_models"),
    ("blurnoise_eval.explorer", "blurnoise_models"),
}
SQL = re.compile(r"\b(SELECT|INSERT (INTO|OR)|DELETE FROM|CREATE (TABLE|INDEX|VIEW)|ALTER TABLE|PRAGMA)\b")

SOURCES = {
    name: path
    for package, folder in PACKAGES.items()
    for name, path in imports_of.modules(package, folder).items()
}
GRAPH = imports_of.graph(SOURCES)


def test_modules_make_no_circle():
    assert not imports_of.circles(GRAPH)


def test_rooms_make_no_circle():
    """Neither files nor folders, each taken as a whole, in any folder."""
    for folder, inside in imports_of.rooms(GRAPH).items():
        assert not imports_of.circles(inside), folder


@pytest.mark.parametrize("folder", FLOORS)
def test_imports_point_down(folder):
    floor = {room: level for level, rooms in enumerate(FLOORS[folder]) for room in rooms}
    above = [
        f"{room} -> {target}"
        for room, targets in imports_of.rooms(GRAPH).get(folder, {}).items()
        for target in targets
        if room in floor and target in floor and floor[target] > floor[room]
    ]
    assert not above, f"in {folder}, imports that point up: {above}"


def test_every_folder_has_a_floor():
    for package, folder in PACKAGES.items():
        named = set().union(*FLOORS[package])
        folders = {path.parent.relative_to(folder).parts[:1] for path in folder.rglob("*.py")} - {()}
        assert {name for (name,) in folders} <= named, f"{package}: add the folder to FLOORS"


def test_packages_meet_as_allowed():
    for module, targets in GRAPH.items():
        package, *inside = module.split(".")
        for target in {name.split(".")[0] for name in targets} - {package}:
            room = f"{package}.{inside[0]}"
            assert target in ALLOWED_ACROSS[package] or (room, target) in EXCEPTIONS, f"{module} -> {target}"


def test_tests_mirror_the_folders():
    tests = ROOT / "tests"
    for path in tests.rglob("test_*.py"):
        top, *inside = path.relative_to(tests).parts
        if not inside:
            assert top in OF_THE_WHOLE_TREE, f"{path}: move it beside the tests of the package it tests"
            continue
        folder = PACKAGES[TESTS[top]].joinpath(*inside[:-1])
        private = PACKAGES[TESTS[top]].joinpath(*(f"_{name}" for name in inside[:-1]))
        assert folder.is_dir() or private.is_dir(), f"{path}: there is no {folder.relative_to(ROOT)}"


def test_sql_stays_in_the_store():
    texts = {name: path.read_text(encoding="utf-8") for name, path in SOURCES.items()}
    asking = {name for name, text in texts.items() if speaks_sql(text)}
    assert {name.rpartition(".")[0] for name in asking} == {"blurnoise_eval.store"}


def speaks_sql(source):
    """Whether a string in the source is a query, or the source opens a database itself."""
    return any(
        (isinstance(node, ast.Constant) and isinstance(node.value, str) and SQL.search(node.value))
        or (isinstance(node, (ast.Import, ast.ImportFrom)) and "sqlite3" in ast.unparse(node))
        for node in ast.walk(ast.parse(source))
    )


def test_all_that_is_printed_goes_through_the_terminal_room():
    """There, names that files give become plain text."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in SOURCES.items()}
    assert {name for name, text in texts.items() if prints(text)} == {"blurnoise_eval.system.terminal"}


def prints(source):
    """Whether the source prints, or makes a console of rich, itself."""
    return any(
        isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("print", "Console")
        for node in ast.walk(ast.parse(source))
    )


NAMED_TWICE: dict[str, set[str]] = {
    # a door for another library
    "RandomExposure": {"blurnoise.albumentations", "blurnoise.training.augmentation"},
}
"""Names that stand for several classes all the same, and where; no further ones."""


def test_no_name_stands_for_two_classes():
    """In all packages, private ones included: who reads a name knows what it is."""
    homes: dict[str, set[str]] = {}
    for module, path in SOURCES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name.lstrip("_"), set()).add(module)
    twice = {name: modules for name, modules in homes.items() if len(modules) > 1}
    assert not {
        name: modules for name, modules in twice.items() if not modules <= NAMED_TWICE.get(name, set())
    }


def test_no_file_is_too_long():
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in SOURCES.items()}
    assert not {name: length for name, length in lengths.items() if length > LONGEST_LINES}


def test_what_travels_together_is_a_record():
    """No function takes a list of keywords that a record should hold."""
    long = {
        f"{module}.{name}"
        for module, path in SOURCES.items()
        for name, count in parameters(path.read_text(encoding="utf-8"))
        if count > MOST_PARAMETERS and module != f"blurnoise_eval.cli.{name}"
    }
    assert long <= WITH_MORE_PARAMETERS


def parameters(source):
    """Each function of a source with the number of its parameters."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            given = node.args
            names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            yield node.name, len([name for name in names if name not in ("self", "cls")])


def test_packages_are_typed_and_project_folders_are_none():
    """In the simulator's root stand ``charts``, which goes with the metrics, and a door of training."""
    assert all((folder / "py.typed").is_file() for folder in PACKAGES.values())
    assert not [name for name in ("eval", "models") if (ROOT / name / "__init__.py").exists()]
    assert {path.stem for path in PACKAGES["blurnoise"].glob("*.py")} == {
        "__init__",
        "albumentations",
        "charts",
    }


def test_no_global_randomness():
    """Randomness is an argument: no module draws from, or seeds, a global generator."""
    forbidden = ("torch.manual_seed", "np.random.seed", "np.random.rand", "random.seed", "torch.seed(")
    for path in SOURCES.values():
        text = path.read_text(encoding="utf-8")
        assert not [word for word in forbidden if word in text], path


# --- what these tests see ---------------------------------------------------


@pytest.mark.parametrize(
    "back",
    [
        "from p.a import x",
        "import p.a as other",
        "from . import a",
        "def f():\n    from p.a import x",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import x",
    ],
)
def test_a_circle_is_seen_however_it_is_imported(tmp_path, back):
    """Of modules, and of folders whose modules make none."""
    files = {"a": "from p.b import y", "b": "from p.c import z", "c": back, "d": "from p.a import x"}
    files |= {"e/one": "from p.f.one import x", "e/two": "", "f/one": "", "f/two": "from p.e.two import x"}
    for name, text in files.items():
        (tmp_path / name).with_suffix(".py").parent.mkdir(exist_ok=True)
        (tmp_path / name).with_suffix(".py").write_text(text)
    found = imports_of.graph(imports_of.modules("p", tmp_path))
    assert imports_of.circles(found) == [["p.a", "p.b", "p.c"]]
    assert ["e", "f"] in imports_of.circles(imports_of.rooms(found)["p"])


def test_parameters_are_counted():
    """Of methods, and those by keyword alone; not those that are collected."""
    assert dict(parameters("class A:\n def f(self, a, /, b=1, *c, d, **e): ...")) == {"f": 3}


def test_what_prints_or_asks_a_database_is_seen():
    assert prints("def f(): print(1)")
    assert not prints("say(1)\n# print(1)\n'print(1)'")
    assert speaks_sql('rows(f"SELECT {name} FROM cells")')
    assert speaks_sql("import sqlite3")
    assert not speaks_sql('"""Select what is measured."""\n# SELECT\nSELECTED = 1')


def test_what_the_simulator_offers_is_typed():
    """Names that are imported on first use are also imported for type checkers and for the guide's reference."""
    tree = ast.parse((PACKAGES["blurnoise"] / "__init__.py").read_text(encoding="utf-8"))
    imported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("blurnoise.")
        for alias in node.names
    }
    assert imported == set(blurnoise.__all__)
