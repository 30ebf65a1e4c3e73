"""The options: few, from the tables of axes and settings; a file holds the rest; an old name says the new one."""

import re
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest
from blurnoise_eval import cli
from blurnoise_eval.cli import COMMANDS, inputs, main
from blurnoise_eval.cli._options import settings
from blurnoise_eval.plan.axes import AXES, OWN_SPECTRUM, axis
from blurnoise_eval.plan.files import PlanFile, SceneFile
from blurnoise_eval.plan.question import Question

MOST_BESIDE_AXES = {"sweep": 18, "simulate": 18, "validate": 15}


class Asked(Exception):
    """Carries the plan that a command was asked for."""


def planned(monkeypatch, *words):
    """The settings that a sweep is begun with."""

    def ask(plan):
        raise Asked(plan)

    monkeypatch.setattr(inputs, "subject", ask)
    with pytest.raises(Asked) as caught:
        main(["sweep", "-o", "run", *words])
    found: PlanFile = caught.value.args[0]
    return found


def params(name):
    return list(cli.command(cli.function(name)).params)


@pytest.mark.parametrize("name", COMMANDS)
def test_options_are_few_and_each_is_explained(name):
    axes = {axis.option for axis in AXES} | {"--light", "--infrared"}  # in place of lux, and beside them
    further = [param for param in params(name) if not axes.intersection(param.opts)]
    assert len(further) <= MOST_BESIDE_AXES.get(name, 14)
    assert all(param.help for param in params(name))


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("columns", [80, 200])
def test_help_names_every_option_in_the_width(name, columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main([*name.split(), "--help"]) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= columns
    assert "\x1b" not in shown
    assert f"blurnoise {name} " in shown
    stated = [word for param in params(name) for word in param.opts if word.startswith("--")]
    assert [word for word in stated if word not in shown] == []


def test_help_is_light():
    """No import of a heavy package for any command's help."""
    code = (
        "import sys, io\n"
        "from blurnoise_eval.cli import main\n"
        "for words in ([], *(c.split() for c in sys.argv[1:])):\n"
        "    sys.stdout = io.StringIO()\n"
        "    main([*words, '--help'])\n"
        "    assert len(sys.stdout.getvalue()) > 200\n"
        "heavy = {'torch', 'numpy', 'cv2', 'onnxruntime', 'onnx', 'kornia', 'matplotlib', 'plotly', 'fsspec'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.__stdout__)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *COMMANDS], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("each", AXES, ids=lambda axis: axis.name)
def test_every_axis_has_its_option_and_its_setting(monkeypatch, each):
    larger, smaller = min(9.0, 0.9 * each.shown(each.high)), min(7.0, 0.7 * each.shown(each.high))
    names = [name for name in each.choices if name != OWN_SPECTRUM]
    text = ",".join(names[::-1]) or f"{larger},{smaller}"
    asked = planned(monkeypatch, each.option, text).plan.grid[each.name]
    if each.choices:
        assert asked == tuple(range(len(names)))
    else:
        assert asked == pytest.approx((smaller * each.per_option, larger * each.per_option), rel=1e-15)
        assert PlanFile.of({each.key: [larger, smaller]}).plan.grid[each.name] == asked
    assert each.key in SceneFile.settings()


def test_numbers_are_read_to_the_last_bit_and_may_begin_with_a_minus(monkeypatch):
    ms = [1, 3, 9, 17, 33, 70, 0.3]
    asked = planned(monkeypatch, "--exposure-ms", ",".join(map(str, ms))).plan.grid
    assert asked["exposure_s"] == tuple(sorted(value / 1e3 for value in ms))
    assert 9 / 1e3 != 9 * 1e-3  # so that another way to count would show
    for words in (["--dx=-200,200"], ["--dx", "-200,200"]):
        assert planned(monkeypatch, *words).plan.grid["velocity_x_px_s"] == (-200, 200)


def test_a_new_axis_is_one_entry(monkeypatch, capsys):
    """Its option, its setting, its values and their words follow."""
    fog = replace(
        axis("gain_db"), name="fog_m", option="--fog-km", about="how far one sees", caption="fog {} km"
    )
    fog = replace(
        fog, per_option=1e3, automatic=False, default=(1e3, 2e3), low=0.0, high=9e3, slugs="fog{}km"
    )
    monkeypatch.setattr(SceneFile, "AXES", (*SceneFile.AXES, fog))
    asked: list[Any] = []

    @settings(SceneFile, "*")
    def look(*, config):
        """Look."""
        asked.append(config.grid["fog_m"])

    for words in ([], ["--fog-km", "4,3"], ["--help"]):
        assert cli.run_alone(look, "look", words) == 0
    assert asked == [(1e3, 2e3), (3e3, 4e3)]
    out = capsys.readouterr().out
    assert "--fog-km NUMBER how far one sees (default: 1,2)" in " ".join(out.replace("│", " ").split())
    assert cli.run_alone(look, "look", ["--fog-km", "10"]) == 2
    assert "--fog-km = 10.0: must be finite and >= 0 and <= 9" in capsys.readouterr().err
    assert (fog.text(2500.0), fog.slug(2500.0)) == ("fog 2.5 km", "fog2.5km")


def test_options_override_the_plan(monkeypatch, tmp_path):
    (tmp_path / "plan.yaml").write_text("lux: [1, 5]\nego_kmh: 30\nkeep: 0.8\nvehicle: {height_m: 1.2}\n")
    asked = planned(
        monkeypatch, "--plan", str(tmp_path / "plan.yaml"), "--ego-kmh", "36", "--model", "a.onnx"
    )
    assert (asked.model, asked.question, asked.plan.vehicle.height_m) == (
        ("a.onnx",),
        Question(keep=0.8),
        1.2,
    )
    assert (asked.plan.grid["illuminance_lux"], asked.plan.grid["ego_speed_m_s"]) == ((1.0, 5.0), (10.0,))


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("sweep -o run --speed 3", "No such option: --speed"),
        (
            "sweep -o run --repeats 2",
            "--repeats; set 'repeats: ...' in a file and pass it as --plan FILE.yaml",
        ),
        (
            "simulate a.png -o b.png --pwm 90,1",
            "--pwm; set 'pwm: ...' in a file and pass it as --scene FILE.yaml",
        ),
        ("sweep", "'--output'"),
        ("paint", "(paint)"),
        ("sweep -o run --limit x", "got 'x'"),
        ("chart mona-lisa -o x.png", "'mona-lisa' is not one of 'slanted-edge'"),
    ],
)
def test_what_no_command_understands_is_told_in_a_line(command, words, capsys):
    with pytest.raises(SystemExit) as end:
        main(command.split())
    assert end.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("blurnoise: error: ")
    assert len(err.splitlines()) == 1, err
    assert words in err
    assert "Value error" not in err


@pytest.mark.parametrize(
    "command",
    ["sweep -o {}", "sweep --save-plan {}/p", "simulate a.png -o {}/b", "chart flat-patch -o {}/c.png",
     "program run -o {}", "report run -o {}", "cameras imx250 --save {}/c.yaml", "train -o {}"],
)  # fmt: skip
def test_nothing_is_computed_for_a_place_that_cannot_be_written(command, tmp_path, capsys):
    place = tmp_path / "file" / "below"
    place.parent.touch()
    assert main(command.format(place).split()) == 2
    assert str(place) in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("lux: 5\nlux: 50\n", "lux: is given twice, again in line 2"),
        ("vehicle: {height_m: 1, height_m: 2}\n", "height_m: is given twice, again in line 1"),
        ("lux: true\n", "lux = True: must be a number"),
        ("seed: yes\n", "seed = True: must be an integer"),
        ("lux: {a: 1}\n", "lux = {'a': 1}: must"),
        ("# seed: 3\n", "contains no setting; must have at least one, such as 'exposure_ms: ...'"),
        ('{"lux": 5,\n "lux": 50}', "lux: is given twice"),
    ],
)
def test_a_file_that_says_two_things_or_no_number_is_refused(content, told, tmp_path):
    path = tmp_path / ("plan.json" if content.startswith("{") else "plan.yaml")
    path.write_text(content)
    with pytest.raises((TypeError, ValueError), match=re.escape(told)):
        PlanFile.read(path)
