"""What is wrong with an option: one line, exit code 2, the option that was typed and the unit of what was typed."""

import pickle

import cv2
import numpy as np
import pytest
from blurnoise_eval.plan.axes import AXES
from commands import main

from blurnoise import charts
from blurnoise._core.checks import OutOfRange
from blurnoise.camera import Camera

Output = pytest.CaptureFixture[str]


COMMANDS = {
    "sweep -o run": [
        ("--exposure-ms -5", "--exposure-ms = -5.0: must be finite and > 0 and <= 3.6e+06"),
        (
            "--exposure-ms auto --gain 5",
            "--exposure-ms = auto: the camera then sets the gain, too; --gain must be auto",
        ),
        ("--ego-kmh 500", "--ego-kmh = 500.0: must be finite and >= 0 and <= 360"),
        ("--ego-kmh 50 --dx 100", "excludes --dx"),
        (
            "--light lit-street,sodium-street",
            "compare them by --lux 20 --illuminant led-4000,sodium --headlamp low",
        ),
        ("--repeats 0", "repeats = 0: must be >= 1"),
        ("--coco missing.json", "--coco = 'missing.json': No such file"),
        ("--labels missing.json", "--labels = 'missing.json': No such file"),
        ("--plan plan.yaml", "keep = 2: must be"),
        ("--plan plan.yaml --keep 3", "--keep = 3.0: must be"),
        ("--coco instances.json", "--coco = 'instances.json': is not a COCO instances file"),
        ("-o file", "Not a directory"),
    ],
    "decide -o run": [("--exposure-ms 5:1", "low:high"), ("--lux -1", "--lux = -1"), ("--gain loud", "loud")],
    "simulate street.png -o out.png": [
        ("--exposure-ms auto --gain 0", "--gain = 0: needs a fixed exposure"),
        ("--exposure-ms -5", "--exposure-ms = -5.0: must be"),
        ("--lux 1,2", "--lux: must be one value"),
        ("--light street,dusk", "--light: must be one value"),
        ("-o out.txt", "suffix"),
        ("--ego-kmh 80 --dx 3", "--ego-kmh: cannot be combined with dx and dy"),
        ("--hdr 0.5", "captures: number 2 saturates at"),
        ("--pwm 90", "pwm = '90': must be HZ,DUTY"),
        (
            "--pwm 90,0.1 --pwm-mask small.png",
            "small.png: a mask must have the size of its picture; they are 17 x 5",
        ),
        ("--emitters mask.png", "emitters = 'mask.png': must be MASK.png:FACTOR"),
        ("--moves targets", "--moves: needs --object"),
        ("--object 1,2,3", "must be MASK.png or X,Y,WIDTH,HEIGHT"),
        ("--object 50,30,20,16 --plate street.png --grey-anchor mean", "cannot be combined with grey_anchor"),
        ("--trajectory sine:3", "--trajectory = 'sine:3': must be FILE.csv, shake:PX or sine:PX,HZ[,DEG]"),
    ],
    "simulate -o out.png": [
        ("missing.png", "missing.png: No such file"),
        ("empty.png", "0 bytes"),
        ("dark.tiff", "negative or infinite light"),
    ],
    "inspect": [
        ("missing.onnx", "missing.onnx: no such file"),
        ("pointer.onnx", "git lfs pull"),
        ("empty.onnx", "empty"),
    ],
    "explore -o out.png": [
        ("--at picture=sign-99", "picture = 'sign-99': is not available"),
        ("--cell abc", "cell: needs a run"),
        (".", "results.sqlite"),
    ],
    "motion --speed-kmh 50 --distance-m 20 --target-width-m 1 --exposure-ms 10": [
        ("--speed-kmh -1", "'--speed-kmh'"),
        ("--speed-kmh 50 --distance-m 0", "--distance-m = 0.0"),
        ("--lens rectilinear --hfov-deg 190", "--hfov-deg = 190"),
    ],
    "report": [("nowhere", "blurnoise sweep"), ("file", "blurnoise sweep")],
    "chart": [("flat-patch --size nan -o out.png", "--size = nan: must be finite")],
    "bench -o run": [
        ("blur --threads 0", "threads"),
        ("blur --model m.onnx", "--model: is for 'sweep'"),
    ],
    "scenes -o run": [("--count 0", "count = 0"), ("--size 100000000", "size_px = 100000000")],
    "measure -o run": [
        ("--repeats 0", "repeats"),
        ("--exposure-ms auto", "--exposure-ms = 'auto': must be numbers"),
        ("--camera hdr.yaml", "captures"),
        ("--moves targets", "moves: must be all"),
    ],
    "measure street.png": [
        ("--roi 0,0,4,4", "8 x 8"),
        ("--coding srgb --black-level 40", "--coding linear"),
        ("--target 65,0.1", "--target: size = 65"),
        ("--target 10", "--target = '10'"),
        ("--lux 5", "--lux: needs simulated charts"),
    ],
    "cameras fit": [
        ("-o x.yaml", "folder, --dng, --libcamera: exactly one"),
        ("frames -o x.txt", "suffix of x.txt"),
        ("frames -o x.yaml --bit-depth 17", "--bit-depth = 17"),
        ("--dng x.dng -o x.yaml --bit-depth 12", "--bit-depth: needs a folder"),
        ("missing -o x.yaml", "folder = 'missing'"),
        ("--dng missing.dng -o x.yaml", "missing.dng"),
    ],
    "cameras": [
        ("pinhole", "camera = 'pinhole': must be a camera file or one of the presets ar0132at"),
        ("bad.yaml", "bad.yaml: field 'read_noise' is unknown (did you mean 'read_noise_e'?)"),
        ("imx250 --save mine.txt", "suffix of mine.txt"),
        ("--save mine.yaml", "--save: needs the name of a camera"),
    ],
}
WRONG = [(f"{command} {words}", text) for command, rows in COMMANDS.items() for words, text in rows]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A street with masks and light, and things that are not what their names say."""
    folder = tmp_path_factory.mktemp("folder")
    picture = np.full((80, 120), 90, np.uint8)
    cv2.imwrite(str(folder / "street.png"), picture)
    cv2.imwrite(str(folder / "mask.png"), picture // 90 * 255)
    cv2.imwrite(str(folder / "small.png"), picture[:5, :17])
    light = np.full((12, 17, 3), 2.5, np.float32)
    for name, values in {"light.tiff": light, "dark.tiff": -light}.items():
        (folder / name).write_bytes(cv2.imencode(".tiff", values)[1].tobytes())
    (folder / "no_pictures").mkdir()
    texts = {
        "plan.yaml": "keep: 2\n",
        "text.onnx": "no model",
        "text.exr": "no picture",
        "file": "x",
        "instances.json": "{ no json",
    }
    texts |= {"empty.onnx": "", "empty.png": "", "bad.yaml": "base: imx250\nread_noise: 3\n"}
    texts["hdr.yaml"] = "base: imx250\ncaptures: [{}, {exposure_ratio: 16}]\n"
    texts |= {"pointer.onnx": "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize(("command", "text"), WRONG, ids=[command for command, _ in WRONG])
def test_bad_input_is_one_line_and_leaves_nothing(folder, capsys, monkeypatch, command, text):
    """The line names the option that was typed, in its unit."""
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    try:
        code = main(command.split())
    except SystemExit as exit:
        code = exit.code  # type: ignore[assignment]
    assert code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("blurnoise: error: "), err
    assert len(err.splitlines()) == 1, err
    assert text in err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("axis", [axis for axis in AXES if not axis.choices], ids=lambda axis: axis.name)
def test_every_axis_is_told_by_its_option(axis, capsys):
    axis = next(each for each in AXES if each is axis)
    beyond = axis.shown(axis.high) * 2
    assert main(["sweep", "-o", "run", axis.option, f"{beyond:g}"]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"blurnoise: error: {axis.option} = "), told
    assert f"<= {axis.shown(axis.high):g}" in told
    assert axis.name not in told or axis.name in axis.option


def test_a_range_that_is_left_survives_the_way_from_a_worker():
    with pytest.raises(OutOfRange) as caught:
        Camera.from_dict({"base": "imx250", "read_noise_e": -1.0})
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) == "read_noise_e = -1.0: must be finite and >= 0 and <= 1e+06"


def test_a_picture_too_large_for_the_memory_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(charts, "flat_patch", lambda *_, **__: np.empty((1 << 28, 1 << 28)))
    assert main(["chart", "flat-patch", "-o", tmp_path / "flat.png"]) == 2
    assert capsys.readouterr().err.startswith("blurnoise: error: out of memory")
    assert not list(tmp_path.iterdir())
