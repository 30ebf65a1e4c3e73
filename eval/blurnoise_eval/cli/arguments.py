"""What the ``blurnoise`` command understands: its commands, their options and the help that teaches them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from blurnoise_eval.cli import arguments_measure, arguments_quality
from blurnoise_eval.cli.arguments_axes import add_axes
from blurnoise_eval.grid.axes import AXES

Command = Callable[[argparse.Namespace], int]

_LISTS = (*(axis.option for axis in AXES), "--roi")
CHARTS = ("slanted-edge", "siemens-star", "stop-sign", "flat-patch")

_DESCRIPTION = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?

  blurnoise sweep -o run                        the whole job on built-in targets
  blurnoise sweep --model M.onnx --images DIR -o run       ... on your own
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
"""
_SWEEP = """\
Run detectors or text recognisers over exposures x lights x speeds x pictures; write curves, pictures, tables
and a page that answers with the exposure to use.

  blurnoise sweep -o run                                             rendered stop signs, the built-in detector
  blurnoise sweep --model a.onnx --coco instances.json -o run        boxes from COCO: AP and all that
  blurnoise sweep --model a.onnx --model b.onnx --images DIR -o run  side by side; targets: found when clean
  blurnoise sweep --ocr -o run                                       the rendered STOP, read

Without pictures: rendered stop signs of 100, 50 and 32 px. A sweep that was stopped goes on where it was when
the same command is given again.
"""
_CAMERAS = """\
List the camera presets, or show every figure of one camera and its source.

  blurnoise cameras                              the presets, a line each
  blurnoise cameras imx250 --save mine.yaml      a starting point for your own
  blurnoise cameras mine.yaml --plot mine.png    variance against mean, and SNR
  blurnoise sweep --camera mine.yaml -o run      the answer for it

A file may hold 'base: imx250' and only the fields that differ.
"""
_INSPECT = """\
Show a model's inputs, outputs and metadata, the family it belongs to and why, every
field of its contract and where that came from, and what nothing in the file tells.

  blurnoise inspect M.onnx                        warnings come from a picture drawn for it
  blurnoise inspect M.onnx --probe photo.jpg      ... from yours, with its detections drawn on it
  blurnoise inspect M.onnx --contract yolov6 --probe photo.jpg    ... as another family

Red and blue swapped, or values 0-1 instead of 0-255, often still find something:
with --probe it says where the opposite would find markedly more.

Presets: yolov5 yolov6 yolov6e2e yolov7 yolov8 yolov10 yolox rtdetr detr rfdetr ppyoloe
mmdeploy nanodet nanodetplus fastestdet torchvision tfod; of text recognisers: ppocr.
"""
_BENCH = """\
Measure on this machine.

  simulate   the whole chain and its stages, beside other libraries
  blur       every way to blur by motion, time beside error
  noise      every way to draw noise, time beside distance from the exact law
  metrics    every way to measure a slanted edge, time beside error
  sweep      a sweep against bare onnxruntime
  augment    what the augmentations cost beside a training step
  training   whether training with the exposure augmentation helps

  blurnoise bench training -o proof --quick      the whole of it in a few minutes, too small to tell anything
  blurnoise bench training -o proof              hours: train 3 arms x 3 seeds, judge them on held-out scenes
  blurnoise bench training -o proof --coco instances.json --images photos     ... and on photographs

training: one small stop-sign network is trained without photometric augmentation (none), with Kornia's motion
blur and noise (kornia), and with blurnoise's RandomExposure (exposure). All see the same scenes, clean and
under a grid of exposures, lights and speeds. Open DIR/training.md and DIR/training.png; the networks stay as
DIR/models/ARM-SEED.onnx. The same command goes on where it was stopped.
"""
_TRAIN = """\
Train the stop-sign detector on rendered scenes and write it as ONNX, with its contract inside.

  blurnoise train -o trained                       as the built-in detector was made: under an hour on two cores
  blurnoise train -o trained --arm none            without the exposure augmentation, to compare
  blurnoise sweep --model trained/stop_sign.onnx -o run       what it is worth

The scenes are drawn once and stay in DIR/pool. Progress: DIR/training.csv.
"""
_GALLERY = """\
Show what ranges of exposure, light and speed do to a picture, before a network
is trained on them: draws as the augmentation blurnoise.augment.RandomExposure
makes them, one tile each, brightest first.

  blurnoise gallery photo.jpg -o gallery.png
  blurnoise gallery photo.jpg -o gallery.png --exposure-ms 1:60 --lux 5:500 \\
      --speed 0:1000 --camera imx250,ar0237 --count 14 --seed 1

A range is low:high, or a number that stays. Exposure and light are drawn
log-uniformly: each doubling is as likely as the next. Speeds are px/s of the
picture as shown, in any direction.
"""
_LIST_HELP = "as 1,5,10 or start:stop:step (stop included)"


def parse(commands: Mapping[str, Command], arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line; ``command`` of the result is the function to call with it."""
    return _parser(commands).parse_args(_with_negative_lists(arguments))


def _with_negative_lists(arguments: Sequence[str]) -> list[str]:
    """Join "--dx -200,200" to "--dx=-200,200": argparse would take the list for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] in _LISTS and argument.startswith("-") and argument[1:2].isdigit():
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def numbers(text: str) -> list[float]:
    """Parse "1,5,10" or "start:stop:step", stop included. Raises ``ArgumentTypeError``."""
    try:
        if ":" not in text:
            return [float(part) for part in text.split(",")]
        start, stop, step = (float(part) for part in text.split(":"))
        count = math.floor((stop - start) / step + 1e-9) + 1
        if step == 0 or count < 1 or count > 100_000:
            raise ValueError
        return [start + step * index for index in range(count)]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r}: must be numbers {_LIST_HELP}") from None


def bounds(text: str) -> tuple[float, float]:
    """Parse "low:high", or one number for both. Raises ``ArgumentTypeError``."""
    try:
        low, high = (float(part) for part in (text if ":" in text else f"{text}:{text}").split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be low:high or a number") from None
    return low, high


def _parser(run: Mapping[str, Command]) -> argparse.ArgumentParser:
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("blurnoise", description=_DESCRIPTION, formatter_class=shape)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, about: str, description: str | None = None) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about, description=description or about, formatter_class=shape)
        made.set_defaults(command=run[name])
        return made

    sweep = command("sweep", "detector x exposures x lights x speeds -> curves and report", _SWEEP)
    _sweep_options(sweep)

    simulate = command("simulate", "one picture as a camera would take it")
    simulate.add_argument(
        "image", type=Path, metavar="IMAGE", help="8- or 16-bit, grey or colour, sRGB-coded"
    )
    simulate.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    simulate.add_argument("--exposure-ms", type=float, default=10.0, help="ms (default 10)")
    simulate.add_argument("--lux", type=float, default=100.0, help="light on the scene, lux (default 100)")
    simulate.add_argument("--dx", type=float, default=0.0, help="motion to the right, px/s (default 0)")
    simulate.add_argument("--dy", type=float, default=0.0, help="motion down, px/s (default 0)")
    simulate.add_argument(
        "--temperature-c", type=float, default=25.0, help="of the sensor, degC (default 25)"
    )
    simulate.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    simulate.add_argument(
        "--fidelity",
        choices=("auto", "full"),
        default="auto",
        help="auto: leave out what changes less than the tolerance (default); full: model everything",
    )
    simulate.add_argument(
        "--tolerance-dn", type=float, default=0.1, help="what auto may leave out, DN RMS (default 0.1)"
    )
    simulate.add_argument(
        "--explain", action="store_true", help="print what each stage contributes, and what is done about it"
    )
    simulate.add_argument(
        "--bit-depth",
        choices=("8", "native"),
        default="8",
        help="8: the sRGB picture to look at (default); native: the camera's digital numbers in a 16-bit PNG",
    )
    _camera_options(simulate)
    _json_option(simulate)

    gallery = command("gallery", "what ranges of conditions do to a picture, as tiles", _GALLERY)
    gallery.add_argument("image", type=Path, metavar="IMAGE", help="8- or 16-bit, grey or colour, sRGB-coded")
    gallery.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png", help="or .pdf, .svg")
    for name, usual, about in (
        ("--exposure-ms", "1:60", "exposure time, ms"),
        ("--lux", "5:500", "light on the scene, lux"),
        ("--speed", "0:1000", "motion, px/s"),
    ):
        gallery.add_argument(
            name, type=bounds, default=bounds(usual), metavar="RANGE", help=f"{about} (default {usual})"
        )
    gallery.add_argument(
        "--camera",
        default="imx250",
        metavar="NAME|FILE,...",
        help="one is drawn for each tile; see 'blurnoise cameras' (default imx250)",
    )
    gallery.add_argument("--count", type=int, default=11, help="tiles beside the picture itself (default 11)")
    gallery.add_argument("--seed", type=int, default=0, help="of the draws and the noise (default 0)")
    gallery.add_argument(
        "--size",
        type=int,
        default=480,
        help="a larger picture is shrunk to this longer side, px (default 480)",
    )
    _json_option(gallery)

    cameras = command("cameras", "the cameras there are, their figures and where these come from", _CAMERAS)
    cameras.add_argument("camera", nargs="?", metavar="NAME|FILE", help="one camera (default: all presets)")
    cameras.add_argument("--save", type=Path, metavar="FILE.yaml", help="write it, to edit; or FILE.json")
    cameras.add_argument("--plot", type=Path, metavar="FILE.png", help="draw its photon transfer, measured")
    _json_option(cameras)

    quality = command(
        "quality", "charts -> every image-quality metric, over exposure and blur", arguments_quality.ABOUT
    )
    arguments_quality.add_options(quality, numbers)
    _camera_option(quality)
    _json_option(quality)

    measure = command(
        "measure", "slanted edges of a picture -> sharpness, noise, information", arguments_measure.ABOUT
    )
    arguments_measure.add_options(measure)
    _json_option(measure)

    motion = command("motion", "road speed -> px/s and blur length")
    motion.add_argument("--speed-kmh", type=float, required=True, help="across the line of sight, km/h")
    motion.add_argument("--distance-m", type=float, required=True)
    motion.add_argument("--target-width-m", type=float, required=True)
    motion.add_argument("--exposure-ms", type=float, required=True)
    motion.add_argument("--width-px", type=float, required=True, help="of the picture")
    motion.add_argument("--hfov-deg", type=float, required=True, help="horizontal field of view")
    motion.add_argument(
        "--lens",
        choices=("f-theta", "rectilinear"),
        default="f-theta",
        help="f-theta: the same px per degree everywhere (default, as in Lin et al. 2024); rectilinear: pinhole",
    )
    _json_option(motion)

    chart = command("chart", "render a test target")
    chart.add_argument("kind", choices=CHARTS, metavar="KIND", help=", ".join(CHARTS))
    chart.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    chart.add_argument("--size", type=float, default=100.0, help="of star and sign, px (default 100)")
    chart.add_argument("--width", type=int, default=320, help="of the picture, px (default 320)")
    chart.add_argument("--height", type=int, default=320, help="of the picture, px (default 320)")
    chart.add_argument("--angle", type=float, help="degrees, counter-clockwise (default: edge 5, others 0)")
    chart.add_argument("--bit-depth", choices=("8", "16"), default="8", help="of the sRGB PNG (default 8)")

    train = command("train", "train the stop-sign detector, and write it as ONNX", _TRAIN)
    train.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    train.add_argument(
        "--arm",
        choices=("none", "kornia", "exposure"),
        default="exposure",
        help="what happens to the pictures: nothing; Kornia's motion blur and noise; RandomExposure (default)",
    )
    train.add_argument("--pictures", type=int, default=80_000, metavar="N", help="seen (default 80000)")
    train.add_argument(
        "--scenes", type=int, default=16_000, metavar="N", help="to see (default 16000; 0.3 MB each)"
    )
    train.add_argument(
        "--size",
        type=int,
        default=320,
        metavar="PX",
        help="of scenes and input, a multiple of 32 (default 320)",
    )
    train.add_argument("--seed", type=int, default=0, help="of weights, order and augmentation (default 0)")
    train.add_argument("--threads", type=int, help="default: every core")
    _json_option(train)

    scenes = command("scenes", "render labelled road-sign scenes, as COCO")
    scenes.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    scenes.add_argument("--count", type=int, default=100, metavar="N", help="default 100")
    scenes.add_argument("--size", type=int, default=320, metavar="PX", help="width and height (default 320)")
    scenes.add_argument(
        "--seed", type=int, default=2, help="which scenes (default 2; trainings use 1, so these are unseen)"
    )

    report = command("report", "write a run's figures, tables and page again")
    report.add_argument("run", type=Path, metavar="RUN")
    report.add_argument(
        "--threshold", type=float, default=0.6, help="confidence that is enough (default 0.6)"
    )
    _json_option(report)

    detections = command("detections", "write what a run's models found as COCO results files")
    detections.add_argument("run", type=Path, metavar="RUN")
    detections.add_argument(
        "-o", "--output", type=Path, metavar="DIR",
        help="a folder per model: instances.json and a file per condition and repeat (default RUN/coco)",
    )  # fmt: skip
    _json_option(detections)

    inspect = command("inspect", "what a model takes and gives, and how it would be read", _INSPECT)
    inspect.add_argument("model", type=Path, metavar="M.onnx")
    inspect.add_argument("--contract", metavar="FILE|PRESET", help="how to read it; see 'sweep --help'")
    inspect.add_argument(
        "--probe", type=Path, metavar="IMAGE", help="list and draw what it finds in this picture"
    )
    inspect.add_argument(
        "-o", "--output", type=Path, metavar="OUT.png", help="of --probe (default MODEL-IMAGE-probe.png)"
    )
    _json_option(inspect)

    bench = command("bench", "measure: speed beside accuracy; what a training gains", _BENCH)
    bench.add_argument(
        "what",
        choices=("simulate", "sweep", "blur", "noise", "metrics", "augment", "training"),
        help="see above",
    )
    bench.add_argument("--model", type=Path, metavar="M.onnx", help="for sweep (default: the built-in one)")
    bench.add_argument("--contract", metavar="FILE|PRESET")
    bench.add_argument(
        "--heavy", action="store_true", help="for sweep: a network of 0.15 s per picture instead of --model"
    )
    bench.add_argument(
        "--images", type=Path, metavar="DIR",
        help="for sweep (default: rendered signs); for training: the folder of --coco's photographs",
    )  # fmt: skip
    bench.add_argument("--threads", type=int, help="default: every core")
    bench.add_argument(
        "-o", "--output", type=Path, metavar="DIR",
        help="for all but sweep: tables, JSON and charts (default bench-simulate, bench-blur, ...)",
    )  # fmt: skip
    bench.add_argument("--quick", action="store_true", help="for all but sweep: less, in seconds or minutes")
    _json_option(bench)
    training = bench.add_argument_group("for training")
    for name, full, quick, about in (
        ("pictures", 18_000, 480, "pictures that each network sees in its training"),
        ("scenes", 9_000, 96, "rendered scenes that these are drawn from, 0.3 MB each on disk"),
        ("seeds", 3, 2, "networks per arm; with one, intervals say nothing about other trainings"),
        ("held-out", 120, 8, "rendered scenes to judge by, which no network has seen"),
    ):
        training.add_argument(
            f"--{name}", type=int, metavar="N", help=f"{about} (default {full}; {quick} with --quick)"
        )
    training.add_argument(
        "--coco", type=Path, metavar="FILE",
        help="photographs to judge by, too: COCO instances with the category 'stop sign'; all pictures count, "
        "those without a sign by what is found in them",
    )  # fmt: skip
    return parser


def _sweep_options(sweep: argparse.ArgumentParser) -> None:
    what = sweep.add_argument_group("what to run")
    what.add_argument(
        "--model",
        type=Path,
        action="append",
        metavar="M.onnx",
        help="a detector or a text recogniser; 'blurnoise inspect M.onnx' says what it is taken for; several "
        "may be named, each with its own --model, to see them side by side (default: the built-in detector)",
    )
    what.add_argument(
        "--contract",
        action="append",
        metavar="FILE|PRESET",
        help="how pictures enter the model and what its classes are: a JSON or YAML file, or a preset; see "
        "'blurnoise inspect --help' (default: MODEL.contract.json beside the model, then its metadata, then "
        "its shape); one for all models, or one for each in their order",
    )
    what.add_argument(
        "--ocr", nargs="?", const="crop", choices=("crop", "find"),
        help="read text with PP-OCR of the installed package rapidocr: in known boxes (crop, the default), or "
        "found by its text detector first (find)",
    )  # fmt: skip
    what.add_argument(
        "--dictionary", type=Path, metavar="FILE", help="a recogniser's characters, a line each"
    )
    what.add_argument(
        "--text-detector", type=Path, metavar="D.onnx",
        help="find text with this (PP-OCR's) before it is read; without it the known boxes are read",
    )  # fmt: skip
    what.add_argument(
        "--images", type=Path, metavar="DIR",
        help="a folder; targets: what is found when clean. With one of the files below: their folder",
    )  # fmt: skip
    what.add_argument("--coco", type=Path, metavar="FILE", help="COCO instances")
    what.add_argument("--yolo", type=Path, metavar="DATA.yaml|DIR", help="YOLO's text labels")
    what.add_argument("--split", metavar="NAME", help="of DATA.yaml (default val, else train)")
    what.add_argument("--bdd", type=Path, metavar="FILE", help="BDD100K detection labels")
    what.add_argument("--text", type=Path, metavar="FILE", help="PP-OCR labels: texts, or texts and places")
    what.add_argument(
        "--target", action="append", default=[], metavar="CLASS", help="only this class, and pictures with it"
    )
    what.add_argument(
        "--keep-empty", action="store_true",
        help="with --target: pictures without it count by what is found in them",
    )  # fmt: skip
    what.add_argument("--limit", type=int, metavar="N", help="only the first N pictures")
    grid = sweep.add_argument_group(f"conditions, each {_LIST_HELP}")
    add_axes(grid, numbers)
    grid.add_argument("--repeats", type=int, help="noise fields per picture (default: rendered 3, else 1)")
    grid.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    _camera_option(sweep)
    sweep.add_argument("--threshold", type=float, default=0.6, help="confidence that is enough (default 0.6)")
    sweep.add_argument("--threads", type=int, help="pictures at a time (default: every core)")
    sweep.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RUN", help="folder for everything"
    )
    _json_option(sweep)


def _camera_options(parser: argparse.ArgumentParser) -> None:
    _camera_option(parser)
    parser.add_argument(
        "--f-number", type=float, metavar="N",
        help="of the lens, in place of the camera's: its light, and its diffraction at 0.55 µm",
    )  # fmt: skip


def _camera_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--camera",
        default="imx250",
        metavar="NAME|FILE",
        help="a preset or a YAML or JSON file; see 'blurnoise cameras' (default imx250)",
    )


def _json_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
