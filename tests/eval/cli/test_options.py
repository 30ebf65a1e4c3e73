"""The options: a grid's follow the table of axes, lists may begin with a minus, every command teaches its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pytest
from blurnoise_eval.cli import COMMANDS, _options, _program, given, main
from blurnoise_eval.cli._help import USUAL
from blurnoise_eval.cli._options import CAMERAS, ENGINE_NAMES, FAMILIES, MODEL_TIMEOUT_S, Grid, axis_options
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.detectors import formats
from blurnoise_eval.detectors.session import TIMEOUT_S
from blurnoise_eval.grid import conditions
from blurnoise_eval.grid.axes import AXES, axis
from blurnoise_eval.sweep import evaluation
from blurnoise_eval.sweep.engines import ENGINES
from typer import Option, Typer
from typer.main import get_command

from blurnoise.optics.camera import PRESETS

Output = pytest.CaptureFixture[str]
NAMES = [run.__name__.replace("_", " ") for run, _ in COMMANDS]
LISTS = [axis.option for axis in AXES if not axis.choices]


class Asked(Exception):
    """Carries the grid that a command was asked for."""


def grid(monkeypatch: pytest.MonkeyPatch, command: str, *options: str) -> dict[str, tuple[float, ...]]:
    """What the command's options make of the grid."""

    def ask(asked: Grid, **_: object) -> None:
        raise Asked(asked)

    monkeypatch.setattr(given, "models", lambda *_, **__: [])
    monkeypatch.setattr(given, "read", lambda models: False)
    monkeypatch.setattr(given, "pictures", lambda **_: PictureSet("folder", "none", ()))
    assert evaluation.SweepPlan is not ask  # it is imported before, or it would keep the stand-in
    monkeypatch.setattr(conditions, "SweepPlan", ask)
    monkeypatch.setattr(Question, "of_grid", ask)
    with pytest.raises(Asked) as caught:
        main([command, "-o", "run", *options])
    return dict(caught.value.args[0])


def test_a_sweep_not_told_tests_what_the_axes_say(monkeypatch: pytest.MonkeyPatch) -> None:
    assert grid(monkeypatch, "sweep") == {axis.name: axis.default for axis in AXES if axis.default}


@pytest.mark.parametrize(
    "options",
    [(), ("--gain", "auto,0,12", "--lux", "0,5"), ("--exposure-ms", "3", "--temperature-c", "25,60"),
     ("--ego-kmh", "0,50"), ("--exposure-ms", "auto", "--moves", "all,targets")],
)  # fmt: skip
def test_deciding_asks_what_a_sweep_tests(monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]) -> None:
    assert grid(monkeypatch, "decide", *options) == grid(monkeypatch, "sweep", *options)


def test_deciding_takes_a_range_for_round_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = grid(monkeypatch, "decide", "--exposure-ms", "1:90", "--speed", "0:100")
    assert asked["exposure_s"] == (0.001, 0.003, 0.01, 0.03, 0.09)
    assert asked["velocity_x_px_s"] == (0.0, 1.0, 3.0, 10.0, 30.0, 100.0)


def test_charts_have_their_own_exposures_and_lights(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = grid(monkeypatch, "quality")
    assert usual["exposure_s"][:2] == (0.0005, 0.001)
    assert usual["illuminance_lux"] == (5.0, 50.0, 500.0)
    assert usual["velocity_y_px_s"] == axis("velocity_y_px_s").default


@pytest.mark.parametrize("command", ["sweep", "quality"])
@pytest.mark.parametrize("each", AXES, ids=lambda axis: axis.name)
def test_every_axis_has_its_option(monkeypatch: pytest.MonkeyPatch, command: str, each: Any) -> None:
    if each.choices:
        asked = grid(monkeypatch, command, each.option, ", ".join(each.choices[::-1]))[each.name]
        assert asked == tuple(range(len(each.choices)))[::-1]
        return
    asked = grid(monkeypatch, command, each.option, "9,7")[each.name]
    assert asked == pytest.approx((9 * each.per_option, 7 * each.per_option), rel=1e-15)


def test_ms_are_thousandths_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    ms = [1, 3, 9, 17, 33, 70, 0.3]
    asked = grid(monkeypatch, "sweep", "--exposure-ms", ",".join(map(str, ms)))
    assert asked["exposure_s"] == tuple(value / 1e3 for value in ms)
    assert 9 / 1e3 != 9 * 1e-3  # so that another way to count would show


@pytest.mark.parametrize("option", LISTS)
@pytest.mark.parametrize("join", [True, False])
def test_lists_may_begin_with_a_minus(monkeypatch: pytest.MonkeyPatch, option: str, join: bool) -> None:
    stated = [f"{option}=-200,200"] if join else [option, "-200,200"]
    (name,) = (axis.name for axis in AXES if axis.option == option)
    per_option = axis(name).per_option
    assert grid(monkeypatch, "sweep", *stated)[name] == (-200 * per_option, 200 * per_option)


def test_a_new_axis_brings_its_option(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    fog = replace(axis("gain_db"), name="fog_m", option="--fog-km", about="how far one sees")
    fog = replace(fog, per_option=1e3, automatic=False)
    monkeypatch.setattr(_options, "AXES", (*AXES, fog))
    asked: list[Grid] = []

    @axis_options(fog_m="1,2")
    def look(*, grid: Grid, eyes: Annotated[int, Option()] = 2) -> None:
        asked.append({**grid, "eyes": (eyes,)})

    program = Typer(rich_markup_mode=None)
    program.command()(look)
    for arguments in ([], ["--fog-km", "-3,4", "--eyes", "1"], ["--help"]):
        get_command(program).main(arguments, standalone_mode=False)
    assert [(each["fog_m"], each["eyes"]) for each in asked] == [((1e3, 2e3), (2,)), ((-3e3, 4e3), (1,))]
    shown = capsys.readouterr().out
    assert "--fog-km LIST" in shown
    assert "how far one sees  [default: 1,2]" in shown


@pytest.mark.parametrize("name", NAMES)
def test_help_names_every_option_and_help_all_explains_it(
    name: str, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    (command,) = _program([name]).commands.values()
    stated = [word for param in command.params for word in param.opts if word.startswith("-")]
    assert stated
    assert all(param.help for param in command.params)
    assert set(USUAL.get(name, ())) <= {param.name for param in command.params}
    for asked, most in (("--help", 4900), ("--help-all", 9800)):
        assert main([name, asked]) == 0
        shown = capsys.readouterr().out
        words = {word.strip(",") for word in shown.split()}
        assert len(shown) < most
        assert not set(shown) & set("─│╭╮╰╯┃━┏")
        options = shown[shown.index("Options:") :]
        assert max(map(len, options.splitlines())) <= 80
        assert f"  blurnoise {name} " in shown or name == "bench"
        assert [
            word for param in command.params for word in param.opts[-1:] if word not in words | {param.name}
        ] == []
    assert [word for word in stated if word not in shown] == []
    assert "More, explained" not in shown


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("columns", [40, 80])
def test_help_fits_and_its_examples_can_be_copied(
    name: str, columns: int, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is broken is continued as a shell reads it; no word of prose is broken."""
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main([*name.split(), "--help-all"]) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= columns
    copied = [
        line for line in shown.replace(" \\\n      ", " ").splitlines() if line.startswith("  blurnoise ")
    ]
    (command,) = _program([name]).commands.values()
    stated = (command.help or "").replace(" \\\n      ", " ").splitlines()
    meant = [line.strip().partition("  ")[0] for line in stated if line.startswith("  blurnoise ")]
    assert [" ".join(line.partition("   ")[0].split("  ")[1:2]) for line in copied] == meant
    assert "egmentatio" not in shown.split()
    assert not {"<Location>", "<path>", "{RUN}"} & set(shown.split())


def test_help_says_the_numbers_that_apply(capsys: Output) -> None:
    assert main(["sweep", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for words in (
        "--exposure-ms auto|LIST exposure times, ms; auto: as the camera sets it for each picture "
        "[default: 0.03,0.1,0.3,1,3,10,30,90]",
        "--lux LIST light on the scene, lux [default: 1,30,1000,20000]",
        "each as 1,5,10 or start:stop:step (stop included)",
    ):
        assert words in shown


def test_programs_help_lists_the_commands(capsys: Output) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    for name, (_, about) in zip(NAMES, COMMANDS, strict=True):
        assert f"  {name:11}  {about}\n" in shown


def test_nothing_to_do_shows_where_to_begin(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    with pytest.raises(SystemExit) as end:
        main([])
    assert end.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n  blurnoise s") == 3
    assert err.endswith("Every command: blurnoise --help; its usual options: blurnoise sweep --help\n")
    assert len(err.splitlines()) <= 12
    assert max(map(len, err.splitlines())) <= 79


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("paint", "'paint'"),
        ("sweep", "'--output'"),
        ("simulate x.png -o y.png --lux bright", "'--lux': must be a number"),
        ("simulate x.png -o y.png --lux bright", "'bright'"),
        ("sweep -o run --exposure-ms 1:2", "'--exposure-ms': '1:2': must be numbers as 1,5,10"),
        ("sweep -o run --exposure-ms 5,1e400", "'--exposure-ms': '5,1e400': must be numbers as 1,5,10"),
        ("sweep -o run --gain inf", "'--gain': 'inf': must be numbers as 1,5,10"),
        (
            "simulate x.png -o y.png --exposure-ms 1e400",
            "'--exposure-ms': '1e400': must be a number, or auto",
        ),
        ("sweep -o run --ocr read", "read"),
        ("sweep -o run --ocr=read", "'read' is not one of 'crop', 'find'"),
        ("sweep -o run --camera", "--camera"),
        ("chart mona-lisa -o x.png", "'mona-lisa' is not one of 'slanted-edge'"),
        ("gallery x.png -o y.png --lux 1:2:3", "must be low:high"),
        ("measure x.png --roi 1,2", "must be x,y,w,h"),
        ("motion --speed 3", "--speed"),
    ],
)
def test_what_no_command_understands_is_told_in_a_line(command: str, words: str, capsys: Output) -> None:
    with pytest.raises(SystemExit) as end:
        main(command.split())
    assert end.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("blurnoise: error: ")
    assert len(err.splitlines()) == 1, err
    assert words in err
    assert "Value error" not in err


def test_numbers_are_coded_one_way(capsys: Output) -> None:
    assert main(["measure", "x.png", "--linear", "--srgb"]) == 2
    assert "--linear, --srgb: must be one of them" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "expected"),
    [((), None), (("--ocr",), "crop"), (("--ocr", "find"), "find"), (("--ocr", "--limit", "1"), "crop")],
)
def test_ocr_may_stand_alone(
    options: Sequence[str], expected: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ask(*_: object, ocr: str | None, **__: object) -> None:
        raise Asked(ocr)

    monkeypatch.setattr(given, "models", ask)
    with pytest.raises(Asked) as caught:
        main(["sweep", "-o", "run", *options])
    assert caught.value.args[0] == expected


def test_completion_knows_what_there_is() -> None:
    assert sorted(ENGINE_NAMES) == sorted(ENGINES)
    assert MODEL_TIMEOUT_S == TIMEOUT_S
    assert sorted(CAMERAS) == sorted(PRESETS)
    assert sorted(FAMILIES) == sorted([*(family.NAME for family in formats.FAMILIES), "ppocr"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("blurnoise sw", ["sweep"]),
        ("blurnoise sweep --thr", ["--threshold", "--threads"]),
        ("blurnoise sweep --defo", ["--defocus-px"]),
        ("blurnoise sweep --camera imx", ["imx250", "imx250c", "imx250m", "imx249"]),
        ("blurnoise inspect m.onnx --contract yolov6", ["yolov6", "yolov6e2e"]),
        ("blurnoise chart s", ["slanted-edge", "siemens-star", "stop-sign"]),
        ("blurnoise sweep --target tr", ["traffic\\ light", "train", "truck"]),
        ("blurnoise cameras f", ["fit"]),
        ("blurnoise cameras fit --ra", ["--raw-size"]),
        ("blurnoise sweep --object-speed bu", ["bus="]),
        ("blurnoise decide --coco shop.json --target s", ["shelf"]),
        ("blurnoise decide --engine p", ["processes"]),
    ],
)
def test_the_shell_completes(words: str, expected: list[str], tmp_path: Path) -> None:
    (tmp_path / "shop.json").write_text('{"categories": [{"name": "shelf"}, {"name": "cart"}]}')
    asked = {
        "_BLURNOISE_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    code = f"import os; os.environ.update({asked!r}); from blurnoise_eval.cli import main; main([])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert sorted(done.stdout.splitlines()) == sorted(expected)
