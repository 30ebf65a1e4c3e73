"""Places that cannot be written: every command looks before it works."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator
from inspect import signature
from pathlib import Path
from typing import Any, get_args, get_origin

import pytest
from blurnoise_eval import cli
from blurnoise_eval.cli import COMMANDS, _options
from blurnoise_eval.system.files import check_writable, check_writable_folder
from blurnoise_eval.system.storage import Location

CHECKED = (_options.new_file, _options.new_folder, _options.new_place)
READ = {
    "model", "dictionary", "text_detector", "images", "coco", "yolo", "bdd", "text", "plates", "run", "runs", "probe",
    "image", "where", "pwm_mask", "plate", "oecf", "simulated", "real", "dng", "folder",
}  # fmt: skip
"""Parameters that name files to read."""
PLACES: dict[str, Callable[[Path, bool], str]] = {
    "read-only": lambda folder, is_file: "/proc/new/a.png" if is_file else "/proc/new",
    "file for a folder": lambda folder, is_file: str(folder / "file" / "a.png"),
    "folder for a file": lambda folder, is_file: str(folder if is_file else folder / "file"),
    "missing parent": lambda folder, is_file: str(
        folder / "none" / "a.png" if is_file else folder / "file" / "b"
    ),
}


def file_options() -> Iterator[tuple[Callable[..., None], str, Any]]:
    """Command, name and Typer's description of every parameter that is a file or a folder."""
    for run, _ in COMMANDS:
        for name, parameter in signature(run, eval_str=True).parameters.items():
            if get_origin(parameter.annotation) is None:
                continue
            kind, described = get_args(parameter.annotation)[:2]
            if {Path, Location} & {kind, *get_args(kind)}:
                yield run, name, described


WRITTEN = [(run, name, told) for run, name, told in file_options() if told.parser in CHECKED]


def test_every_file_is_read_or_looked_at_before_it_is_written() -> None:
    others = {name for _, name, told in file_options() if told.parser not in CHECKED}
    assert others - READ == set()
    assert {run.__name__ for run, _, _ in WRITTEN} == {run.__name__ for run, _ in COMMANDS}


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="has no place where nobody may write")
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("run", "name", "told"), WRITTEN, ids=lambda each: getattr(each, "__name__", None))
def test_no_work_for_what_cannot_be_written(
    run: Callable[..., None],
    name: str,
    told: Any,
    place: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    @functools.wraps(run)
    def work(**_: object) -> None:
        pytest.fail("works")

    (tmp_path / "file").touch()
    monkeypatch.setattr(cli, "COMMANDS", ((work, ""),))
    command = run.__name__.replace("_", " ")
    where = PLACES[place](tmp_path, told.parser is _options.new_file)
    asked = [command, *_needed(command, name), _option(command, name), where]
    assert cli.main(asked) == 2
    said = capsys.readouterr().err
    assert re.fullmatch(rf"blurnoise: error: {re.escape(where)}: [A-Z][a-z ]+\n", said)
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def _params(command: str) -> list[Any]:
    return list(cli._program([command]).commands[command].params)


def _option(command: str, name: str) -> str:
    (option,) = [each.opts[-1] for each in _params(command) if each.name == name]
    return str(option)


def _needed(command: str, name: str) -> list[str]:
    """What else a command cannot do without."""
    words: list[str] = []
    for each in _params(command):
        if each.required and each.name != name:
            value = {"what": "blur", "pattern": "ring"}.get(each.name, "1")
            words += [value] if each.param_type_name == "argument" else [each.opts[-1], value]
    return words


@pytest.mark.parametrize("name", ["run", "a/b/c"])
def test_places_that_can_be_written_stay_as_they_were(name: str, tmp_path: Path) -> None:
    check_writable(tmp_path / "a.png")
    check_writable_folder(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command", ["report run", "detections run", "bench blur", "inspect m.onnx --save-contract"]
)
def test_usual_places_are_looked_at_too(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from blurnoise_models.detector import STOP_SIGN

    (tmp_path / "m.onnx").write_bytes(STOP_SIGN.read_bytes())
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path)

    def refuse(path: Path) -> None:
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr(_options, "check_writable", refuse)
    monkeypatch.setattr(_options, "check_writable_folder", refuse)
    assert cli.main(command.split()) == 2
    assert capsys.readouterr().err.endswith(": Read-only file system\n")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["m.onnx", "run"]
