"""Commands called in the test's process, and pictures to give them."""

import json
import tempfile
from dataclasses import fields
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import yaml
from blurnoise_eval import cli

from blurnoise.motion.ego import Vehicle

Output = pytest.CaptureFixture[str]
MODULES = {name: f"blurnoise_eval.{name}" for name in ("bench", "scenes")}
FLAGS = {"--no-refine": ("refine", False), "--keep-empty": ("keep_empty", True)}
VEHICLE = {each.name for each in fields(Vehicle)}


def main(words):
    """The command line, or a module's; what is stated as an option and has none is a setting in a file."""
    name, *rest = map(str, words)
    if name in MODULES:
        module = import_module(MODULES[name] + (".__main__" if name == "bench" else ""))
        return cli.run_alone(getattr(module, name), f"python -m {MODULES[name]}", rest)
    return cli.main([name, *in_a_file(name, rest)])


def in_a_file(command, words):
    """The words with those options that have to stand in a file in one."""
    if not hasattr(cli.function(command) if command in cli.COMMANDS else None, "settings"):
        return words
    file, kind = cli.function(command).settings  # type: ignore[attr-defined]
    options = {each for param in cli.command(cli.function(command)).params for each in param.opts}
    left: list[str] = []
    stated: dict[str, Any] = {}
    while words:
        word, *words = words
        field = word.lstrip("-").replace("-", "_")
        if word in FLAGS:
            stated |= [FLAGS[word]]
        elif not word.startswith("--") or word in options or "=" in word:
            left.append(word)
        elif field in kind.settings() or field in VEHICLE:
            value, *words = words
            at = stated.setdefault("vehicle", {}) if field in VEHICLE else stated
            at[field] = yaml.safe_load(value)
        else:
            left.append(word)
    if not stated:
        return left
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as written:
        yaml.safe_dump(stated, written)
    return [*left, f"--{file}", written.name]


def told(capsys, *arguments):
    """The JSON that a command prints, which must succeed."""
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def stated(folder, **settings):
    """A file of settings."""
    path = folder / "settings.yaml"
    path.write_text(yaml.safe_dump(settings))
    return str(path)


def pixels(shape, dtype=np.uint8):
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
