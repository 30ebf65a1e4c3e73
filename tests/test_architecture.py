"""The architecture, as in the imports and the tree: what stands on which floor, and that nothing goes in circles.

A circle is found wherever it is, so floors name only what a circle would not show: what may never know of what.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imports_of
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "blurnoise": ROOT / "blurnoise",
    "blurnoise_eval": ROOT / "eval" / "blurnoise_eval",
    "blurnoise_models": ROOT / "models" / "blurnoise_models",
}
TESTS = {"blurnoise": "blurnoise", "eval": "blurnoise_eval", "models": "blurnoise_models"}
"""Folder of the tests to the package that it mirrors."""
OF_THE_WHOLE_TREE = {"test_architecture.py", "test_documentation.py"}
"""Tests that belong to no package, in tests/ itself."""
LONGEST_LINES = 450

FLOORS: dict[str, list[set[str]]] = {
    "blurnoise": [
        {"_core", "charts", "metrics"},
        {"optics"},
        {"motion"},
        {"blur"},
        {"light"},
        {"sensor", "picture"},
        {"scene"},
        {"training"},
    ],
    "blurnoise.metrics": [
        {"values"},
        {"edge", "patches"},
        {"information"},
    ],
    "blurnoise_eval": [
        {"system", "grid", "detectors"},
        {"datasets"},
        {"store"},
        {"scoring"},
        {"answers"},
        {"plots"},
        {"sweep"},
        {"report"},
        {"deciding"},
        {"program"},
        {"quality", "calibration", "simulation"},
        {"validation"},
        {"explorer"},
        {"cli"},
        {"bench", "maps", "paper"},
    ],
    "blurnoise_eval.detectors": [
        {"records", "contract"},
        {"model"},
        {"formats"},
        {"contract_files", "recognition"},
        {"detector", "ocr"},
        {"opening"},
    ],
    "blurnoise_models": [
        {"scenes", "network"},
        {"training", "export"},
        {"arms", "matched_filter", "detector"},
    ],
}
"""Folder to what stands in it, floor by floor: none imports from a floor above its own. What is not named stands
where it likes, as long as it makes no circle; folders directly in a package have to be named."""

ALLOWED_ACROSS = {"blurnoise": set(), "blurnoise_eval": {"blurnoise"}, "blurnoise_models": {"blurnoise"}}
EXCEPTIONS = {
    (
        "blurnoise_eval.cli",
        "blurnoise_models",
    ): "the command offers the built-in detector and makes such ones",
    ("blurnoise_eval.evaluation", "blurnoise_models"): "so does evaluate, its twin in Python",
    ("blurnoise_eval.bench", "blurnoise_models"): "a training step is measured, too",
    ("blurnoise_eval.scenes", "blurnoise_models"): "the scenes are those that the detector was trained on",
    ("blurnoise_eval.explorer", "blurnoise_models"): "a run's built-in detector is found wherever it lay",
}
CIRCLES: dict[tuple[str, ...], str] = {}
"""Circles that stay, sorted, with the reason."""
HIDDEN: dict[str, str] = {}
"""Modules whose name their package gives to something else, with the reason."""
SQL_OUTSIDE: dict[str, str] = {}
SQL = re.compile(
    r"\b(SELECT|INSERT INTO|INSERT OR|DELETE FROM|CREATE (TABLE|INDEX|VIEW)|ALTER TABLE|PRAGMA)\b"
)

SOURCES = {
    name: path
    for package, folder in PACKAGES.items()
    for name, path in imports_of.modules(package, folder).items()
}
GRAPH = imports_of.graph(SOURCES)


def as_allowed(what: str, found: set[Any], allowed: dict[Any, str]) -> None:
    """Whether what was found is what is allowed: nothing new, and no permission that nobody needs."""
    assert not found - set(allowed), f"{what}: {sorted(found - set(allowed))}"
    assert not set(allowed) - found, f"{what}: take off the list, it is gone: {sorted(set(allowed) - found)}"


def test_modules_make_no_circle() -> None:
    as_allowed("a circle", {tuple(found) for found in imports_of.circles(GRAPH)}, CIRCLES)


def test_rooms_make_no_circle() -> None:
    """Neither files nor folders, each taken as a whole, in any folder."""
    for folder, inside in imports_of.rooms(GRAPH).items():
        assert not imports_of.circles(inside), folder


@pytest.mark.parametrize("folder", FLOORS)
def test_imports_point_down(folder: str) -> None:
    floor = {room: level for level, rooms in enumerate(FLOORS[folder]) for room in rooms}
    above = [
        f"{room} -> {target}"
        for room, targets in imports_of.rooms(GRAPH).get(folder, {}).items()
        for target in targets
        if room in floor and target in floor and floor[target] > floor[room]
    ]
    assert not above, f"in {folder}, imports that point up: {above}"


def test_every_folder_has_a_floor() -> None:
    for package, folder in PACKAGES.items():
        named = set().union(*FLOORS[package])
        folders = {path.parent.relative_to(folder).parts[:1] for path in folder.rglob("*.py")} - {()}
        assert {name for (name,) in folders} <= named, f"{package}: add the folder to FLOORS"


def test_packages_meet_as_allowed() -> None:
    for module, targets in GRAPH.items():
        package, *inside = module.split(".")
        for target in {name.split(".")[0] for name in targets} - {package}:
            room = f"{package}.{inside[0]}"
            assert target in ALLOWED_ACROSS[package] or (room, target) in EXCEPTIONS, f"{module} -> {target}"


def test_no_name_hides_a_module() -> None:
    """``from package import module`` gives the module: the package's door calls nothing else by that name."""
    hidden = {
        f"{door.removesuffix('.__init__')}.{name}"
        for door, path in SOURCES.items()
        if door.endswith(".__init__")
        for name in hiding(door.removesuffix(".__init__"), path)
    }
    as_allowed("a module that a name of its package hides", hidden, HIDDEN)


def hiding(package: str, path: Path) -> Iterator[str]:
    """Names that a package's ``__init__.py`` binds to something else than the module of that name beside it."""
    beside = {each.stem for each in path.parent.iterdir() if each.suffix == ".py" or each.is_dir()}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            source = f"{package}.{node.module or ''}".rstrip(".") if node.level else node.module
            bound = {alias.asname or alias.name for alias in node.names if source != package or alias.asname}
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            bound = {node.name}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound = {node.id}
        else:
            continue
        yield from bound & beside


def test_tests_mirror_the_folders() -> None:
    tests = ROOT / "tests"
    for path in tests.rglob("test_*.py"):
        top, *inside = path.relative_to(tests).parts
        if not inside:
            assert top in OF_THE_WHOLE_TREE, f"{path}: move it beside the tests of the package it tests"
            continue
        folder = PACKAGES[TESTS[top]].joinpath(*inside[:-1])
        private = PACKAGES[TESTS[top]].joinpath(*(f"_{name}" for name in inside[:-1]))
        assert folder.is_dir() or private.is_dir(), f"{path}: there is no {folder.relative_to(ROOT)}"


def test_sql_stays_in_the_store() -> None:
    asking = {
        name
        for name, path in SOURCES.items()
        if not name.startswith("blurnoise_eval.store.") and speaks_sql(path.read_text(encoding="utf-8"))
    }
    as_allowed("SQL outside the store", asking, SQL_OUTSIDE)


def speaks_sql(source: str) -> bool:
    """Whether a string in the source is a query, or the source opens a database itself."""
    return any(
        (isinstance(node, ast.Constant) and isinstance(node.value, str) and SQL.search(node.value))
        or (isinstance(node, (ast.Import, ast.ImportFrom)) and "sqlite3" in ast.unparse(node))
        for node in ast.walk(ast.parse(source))
    )


def test_all_that_is_printed_goes_through_the_terminal_room() -> None:
    """There, names that files give become plain text."""
    printing = {
        name
        for name, path in SOURCES.items()
        if name != "blurnoise_eval.system.terminal" and prints(path.read_text(encoding="utf-8"))
    }
    assert not printing


def prints(source: str) -> bool:
    """Whether the source prints, or makes a console of rich, itself."""
    return any(
        isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("print", "Console")
        for node in ast.walk(ast.parse(source))
    )


def test_no_file_is_too_long() -> None:
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in SOURCES.items()}
    assert not {name: length for name, length in lengths.items() if length > LONGEST_LINES}


def test_project_folders_are_no_packages() -> None:
    assert not (ROOT / "eval" / "__init__.py").exists()
    assert not (ROOT / "models" / "__init__.py").exists()


def test_the_root_holds_folders() -> None:
    """And ``charts``, which goes with the metrics, and a door of training under the name of its package."""
    root = {path.stem for path in PACKAGES["blurnoise"].glob("*.py")} - {"__init__"}
    assert root == {"albumentations", "charts"}


def test_every_package_is_typed() -> None:
    assert all((folder / "py.typed").is_file() for folder in PACKAGES.values())


def test_no_global_randomness() -> None:
    """Randomness is an argument: no module draws from, or seeds, a global generator."""
    forbidden = ("torch.manual_seed", "np.random.seed", "np.random.rand", "random.seed", "torch.seed(")
    for path in SOURCES.values():
        text = path.read_text(encoding="utf-8")
        assert not [word for word in forbidden if word in text], path


# --- what these tests see ---------------------------------------------------


def tree(folder: Path, **files: str) -> dict[str, set[str]]:
    """The graph of a package `p` of the given files; `a__b` is the file a/b.py."""
    for name, text in files.items():
        path = folder.joinpath(*name.split("__")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return imports_of.graph(imports_of.modules("p", folder))


@pytest.mark.parametrize(
    "back",
    [
        "from p.a import x",
        "from p import a",
        "import p.a",
        "import p.a as other",
        "from .a import x",
        "from . import a",
        "def f():\n    from p.a import x",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import x",
    ],
)
def test_a_circle_is_seen_however_it_is_imported(tmp_path: Path, back: str) -> None:
    found = tree(tmp_path, a="from p.b import y", b="from p.c import z", c=back, d="from p.a import x")
    assert imports_of.circles(found) == [["p.a", "p.b", "p.c"]]


def test_a_circle_through_a_door_is_seen(tmp_path: Path) -> None:
    (tmp_path / "q").mkdir()
    (tmp_path / "q" / "__init__.py").write_text("from p.q.a import x")
    assert imports_of.circles(tree(tmp_path, q__a="from p.q import x")) == [["p.q.__init__", "p.q.a"]]


def test_a_circle_of_folders_is_seen_where_modules_make_none(tmp_path: Path) -> None:
    found = tree(
        tmp_path, a__one="from p.b.one import x", a__two="", b__one="", b__two="from p.a.two import x"
    )
    assert not imports_of.circles(found)
    assert imports_of.rooms(found)["p"] == {"a": {"b"}, "b": {"a"}}
    assert imports_of.circles(imports_of.rooms(found)["p"]) == [["a", "b"]]


def test_what_hides_a_module_is_seen(tmp_path: Path) -> None:
    door = tmp_path / "__init__.py"
    for name in ("a", "b", "c", "d"):
        (tmp_path / f"{name}.py").touch()
    door.write_text(
        "from p.a import a\nfrom p import b\nfrom .x import y as c\ndef d(): ...\nfrom p.a import e"
    )
    assert set(hiding("p", door)) == {"a", "c", "d"}


def test_what_prints_is_seen() -> None:
    assert prints("def f(): print(1)")
    assert prints("rich.console.Console().width")
    assert not prints("say(1)\n# print(1)\n'print(1)'")


def test_a_query_is_seen() -> None:
    assert speaks_sql('rows(f"SELECT {name} FROM cells")')
    assert speaks_sql("import sqlite3")
    assert not speaks_sql('"""Select what is measured."""\n# SELECT\nSELECTED = 1')
