"""The examples in docstrings: every module that has some is run by doctest."""

import doctest
import importlib
from pathlib import Path

import imports_of
import pytest
import torchvision_ops

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "blurnoise": ROOT / "blurnoise",
    "blurnoise_eval": ROOT / "eval" / "blurnoise_eval",
    "blurnoise_models": ROOT / "models" / "blurnoise_models",
}
MODULES = sorted(
    name
    for package, folder in PACKAGES.items()
    for name, path in imports_of.modules(package, folder).items()
    if ">>>" in path.read_text(encoding="utf-8")
)
NEEDED = {
    "blurnoise.albumentations": lambda: pytest.importorskip("albumentations"),
    "blurnoise.training.torchvision": torchvision_ops.detectors,
}
"""Modules for packages that may be missing, and what skips them there."""


@pytest.mark.parametrize("name", MODULES)
def test_examples_show_what_happens(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_ALBUMENTATIONS_UPDATE", "1")  # which else asks the network at import
    NEEDED.get(name, lambda: None)()
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    failed, tried = doctest.testmod(importlib.import_module(name), optionflags=options)
    assert tried
    assert not failed
