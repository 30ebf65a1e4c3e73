"""The house's floors, as in the imports: a module imports only what stands below it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "blurnoise": ROOT / "blurnoise",
    "blurnoise_eval": ROOT / "eval" / "blurnoise_eval",
    "blurnoise_models": ROOT / "models" / "blurnoise_models",
}
FLOORS = {
    "blurnoise": [
        {
            "checks",
            "rng",
            "spectra",
            "charts",
            "encoding",
            "borders",
            "transfer",
            "scratch",
            "threads",
            "presets",
        },
        {"camera", "motion", "psf", "packed"},
        {"fourier", "frames", "sensor", "metrics"},
        {"blur", "moments", "plan"},
        {"simulate"},
        {"augment"},
        {"augment_torchvision"},
    ],
    "blurnoise_eval": [
        {
            "records",
            "class_names",
            "contract",
            "arguments",
            "arguments_measure",
            "arguments_quality",
            "conditions",
            "files",
            "printing",
        },
        {"formats"},
        {
            "edges",
            "onnx_model",
            "suspicions",
            "reading",
            "datasets",
            "scoring",
            "store",
            "cameras",
        },
        {"exposing", "judging", "scores", "curves", "measuring"},
        {"sweep", "latency", "coco_files", "optimum", "pictures"},
        {"report", "gallery", "edge_figures"},
        {"results"},
        {"bench"},
        {"quality"},
        {"quality_figures", "quality_table"},
        {"cli"},
    ],
}
ALLOWED_ACROSS = {
    "blurnoise": set(),
    "blurnoise_eval": {"blurnoise"},
    "blurnoise_models": {"blurnoise"},
}
EXCEPTIONS = {
    (
        "blurnoise_eval.cli",
        "blurnoise_models",
    ): "the command offers the built-in detector and makes such ones",
    (
        "blurnoise_eval.sweep",
        "blurnoise_models",
    ): "evaluate runs the built-in detector where none is named, as the command does",
}
SAME_FLOOR = {
    ("charts", "checks"): "guards",
    ("arguments", "arguments_quality"): "a part of it",
    ("arguments", "arguments_measure"): "a part of it",
    ("suspicions", "onnx_model"): "it runs a detector in other ways",
    ("contract", "class_names"): "presets name COCO's classes",
    ("transfer", "checks"): "guards",
    ("rng", "threads"): "items side by side",
    ("sensor", "frames"): "its route on the CPU without derivatives",
    ("encoding", "threads"): "pieces side by side",
    ("presets", "spectra"): "quantum efficiencies are curves",
    ("reading", "onnx_model"): "one way to open a model file",
}


def modules() -> list[tuple[str, str, Path]]:
    found = []
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found.append((package, parts[0], path))
    return found


def imported(path: Path) -> set[str]:
    """Dotted names that the file imports at run time, type-checking blocks left out."""
    names: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return names


def floor(package: str, module: str) -> int:
    for level, names in enumerate(FLOORS.get(package, [])):
        if module in names:
            return level
    raise AssertionError(f"{package}.{module} stands on no floor: add it to FLOORS")


@pytest.mark.parametrize(("package", "module", "path"), modules(), ids=lambda value: str(value)[-40:])
def test_imports_point_down(package: str, module: str, path: Path) -> None:
    for name in imported(path):
        top, _, rest = name.partition(".")
        if top not in PACKAGES:
            continue
        if top != package:
            allowed = ALLOWED_ACROSS[package]
            assert top in allowed or (f"{package}.{module}", top) in EXCEPTIONS, f"{path} imports {name}"
            continue
        target = rest.split(".")[0]
        if package not in FLOORS or module == "__init__" or target == module or target not in _names(package):
            continue
        below = floor(package, target) < floor(package, module)
        assert below or (module, target) in SAME_FLOOR, (
            f"{path} imports {name}, which does not stand below it"
        )


def _names(package: str) -> set[str]:
    return set().union(*FLOORS[package])


def test_every_module_has_a_floor() -> None:
    for package, module, path in modules():
        if package in FLOORS and path.name != "__init__.py":
            floor(package, module)


def test_projects_folders_are_no_packages() -> None:
    assert not (ROOT / "eval" / "__init__.py").exists()
    assert not (ROOT / "models" / "__init__.py").exists()


def test_no_global_randomness() -> None:
    """Randomness is an argument: no module draws from, or seeds, a global generator."""
    forbidden = ("torch.manual_seed", "np.random.seed", "np.random.rand", "random.seed", "torch.seed(")
    for _, _, path in modules():
        text = path.read_text(encoding="utf-8")
        assert not [word for word in forbidden if word in text], path
