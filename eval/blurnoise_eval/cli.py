"""The ``blurnoise`` command. Heavy imports happen inside the commands, so that ``--help`` is immediate."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.sweep import Outcome

EXPOSURES_MS = "1,2,5,10,15,20,30,45,60,90"
ILLUMINANCES_LUX = "1,10,100"
VELOCITIES_PX_S = "0,200,500,1000"
_LISTS = ("--exposure-ms", "--lux", "--dx", "--dy")
CHARTS = ("slanted-edge", "siemens-star", "stop-sign", "flat-patch")

_DESCRIPTION = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?

  blurnoise sweep -o run                        the whole job on built-in targets
  blurnoise sweep --model M.onnx --images DIR -o run       ... on your own
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
"""
_SWEEP = """\
Run a detector over exposures x lights x speeds x pictures; write curves,
pictures, tables and a page that answers with the exposure to use.

Without --model: a built-in matched filter. Without --images or --coco: rendered
stop signs of 100, 50 and 32 px. A sweep that was stopped goes on where it was
when the same command is given again.
"""
_LIST_HELP = "as 1,5,10 or start:stop:step (stop included)"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 2 for bad input, 130 when interrupted."""
    options = _parser().parse_args(_with_negative_lists(sys.argv[1:] if arguments is None else arguments))
    try:
        return int(options.command(options))
    except (ValueError, TypeError, OSError) as error:
        print(f"blurnoise: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("blurnoise: interrupted; what was finished is kept", file=sys.stderr)
        return 130


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


def _parser() -> argparse.ArgumentParser:
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("blurnoise", description=_DESCRIPTION, formatter_class=shape)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Any, about: str, description: str | None = None) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about, description=description or about, formatter_class=shape)
        made.set_defaults(command=run)
        return made

    sweep = command("sweep", _sweep, "detector x exposures x lights x speeds -> curves and report", _SWEEP)
    _sweep_options(sweep)

    simulate = command("simulate", _simulate, "one picture as a camera would take it")
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
        "--bit-depth",
        choices=("8", "native"),
        default="8",
        help="8: the sRGB picture to look at (default); native: the camera's digital numbers in a 16-bit PNG",
    )
    _camera_options(simulate)
    _json_option(simulate)

    motion = command("motion", _motion, "road speed -> px/s and blur length")
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

    chart = command("chart", _chart, "render a test target")
    chart.add_argument("kind", choices=CHARTS, metavar="KIND", help=", ".join(CHARTS))
    chart.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    chart.add_argument("--size", type=float, default=100.0, help="of star and sign, px (default 100)")
    chart.add_argument("--width", type=int, default=320, help="of the picture, px (default 320)")
    chart.add_argument("--height", type=int, default=320, help="of the picture, px (default 320)")
    chart.add_argument("--angle", type=float, help="degrees, counter-clockwise (default: edge 5, others 0)")
    chart.add_argument("--bit-depth", choices=("8", "16"), default="8", help="of the sRGB PNG (default 8)")

    report = command("report", _report, "write a run's figures, tables and page again")
    report.add_argument("run", type=Path, metavar="RUN")
    report.add_argument(
        "--threshold", type=float, default=0.6, help="confidence that is enough (default 0.6)"
    )
    _json_option(report)

    inspect = command("inspect", _inspect, "what a model takes and gives, and how it would be read")
    inspect.add_argument("model", type=Path, metavar="M.onnx")
    inspect.add_argument("--contract", metavar="FILE|PRESET", help="how to read it; see 'sweep --help'")
    _json_option(inspect)

    bench = command("bench", _bench, "measure this machine: speed beside accuracy")
    bench.add_argument(
        "what", choices=("simulate", "sweep"), help="one picture; a sweep against bare onnxruntime"
    )
    bench.add_argument("--model", type=Path, metavar="M.onnx", help="for sweep (default: the built-in one)")
    bench.add_argument("--contract", metavar="FILE|PRESET")
    bench.add_argument("--images", type=Path, metavar="DIR", help="for sweep (default: rendered signs)")
    bench.add_argument("--threads", type=int, help="default: every core")
    _json_option(bench)
    return parser


def _sweep_options(sweep: argparse.ArgumentParser) -> None:
    what = sweep.add_argument_group("what to run")
    what.add_argument(
        "--model", type=Path, metavar="M.onnx", help="YOLOv5, YOLOv8, YOLOX or FastestDet export"
    )
    what.add_argument(
        "--contract",
        metavar="FILE|PRESET",
        help="how pictures enter the model and what its classes are: a JSON or YAML file, or yolov5, yolov8, "
        "yolox, fastestdet (default: MODEL.contract.json beside the model, then its metadata, then its shape)",
    )
    what.add_argument(
        "--images", type=Path, metavar="DIR", help="a folder; targets: what is found when clean"
    )
    what.add_argument("--coco", type=Path, metavar="FILE", help="COCO instances; with --images: their folder")
    what.add_argument(
        "--target", action="append", default=[], metavar="CLASS", help="only these COCO classes"
    )
    what.add_argument("--limit", type=int, metavar="N", help="only the first N pictures")
    grid = sweep.add_argument_group(f"conditions, each {_LIST_HELP}")
    for name, default, about in (
        ("--exposure-ms", EXPOSURES_MS, "exposure times, ms"),
        ("--lux", ILLUMINANCES_LUX, "light on the scene, lux"),
        ("--dx", VELOCITIES_PX_S, "motion to the right, px/s"),
        ("--dy", "0", "motion down, px/s"),
    ):
        grid.add_argument(
            name, type=numbers, default=numbers(default), metavar="LIST", help=f"{about} (default {default})"
        )
    grid.add_argument("--repeats", type=int, help="noise fields per picture (default: rendered 3, else 1)")
    grid.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    grid.add_argument("--temperature-c", type=float, default=25.0, help="of the sensor, degC (default 25)")
    _camera_options(sweep)
    sweep.add_argument("--threshold", type=float, default=0.6, help="confidence that is enough (default 0.6)")
    sweep.add_argument("--threads", type=int, help="pictures at a time (default: every core)")
    sweep.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RUN", help="folder for everything"
    )
    _json_option(sweep)


def _camera_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--camera", default="imx250", metavar="NAME", help="a preset (default imx250)")
    parser.add_argument("--f-number", type=float, metavar="N", help="of the lens, in place of the preset's")


def _json_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _sweep(options: argparse.Namespace) -> int:
    camera = _camera(options)
    from blurnoise.checks import in_range
    from blurnoise_eval import results, sweep
    from blurnoise_eval.contract import load_contract
    from blurnoise_eval.store import Store

    in_range("threshold", options.threshold, 0.0, 1.0)
    threads = _threads(options)
    pictures = _pictures(options)
    repeats = options.repeats if options.repeats is not None else (3 if pictures.kind == "rendered" else 1)
    plan = sweep.Plan(
        exposures_s=tuple(value / 1e3 for value in options.exposure_ms),
        illuminances_lux=tuple(options.lux),
        velocities_x_px_s=tuple(options.dx),
        velocities_y_px_s=tuple(options.dy),
        repeats=repeats,
        seed=options.seed,
        temperature_c=options.temperature_c,
    )
    given = None if options.model is None else _detector(options, options.output)
    if options.contract is not None:
        load_contract(options.contract)  # before a folder is made
    with Store(options.output, create=True) as store:
        detector = given or _detector(options, options.output)
        _print_assumptions(detector.contract, options.model)
        facts = {"command": " ".join(["blurnoise", *sys.argv[1:]]), "threads": threads}
        results.open_run(store, detector, camera, pictures, plan, facts)
        with _Progress("sweep", sweep.count_cells(pictures, plan)) as advance:
            outcome = sweep.run(detector, camera, pictures, plan, store, threads=threads, progress=advance)
        if outcome.skipped and len(outcome.skipped) == len(pictures):
            raise ValueError(f"images: none could be read (first: {next(iter(outcome.skipped.values()))})")
        manifest = store.about("manifest")
        store.set_about("manifest", {**manifest, "wall_s": manifest.get("wall_s", 0.0) + outcome.wall_s})
        return _finish(store, options, outcome)


def _report(options: argparse.Namespace) -> int:
    from blurnoise.checks import in_range
    from blurnoise_eval.store import Store

    in_range("threshold", options.threshold, 0.0, 1.0)
    with Store(options.run) as store:
        return _finish(store, options, None)


def _finish(store: Any, options: argparse.Namespace, outcome: Outcome | None) -> int:
    """Tables, figures and page of a run; the answer in the terminal."""
    from blurnoise_eval import report, results

    store.export()
    data = results.read_run(store, threshold=options.threshold)
    summary = {
        "run": str(store.folder),
        "report": str(store.folder / "report.html"),
        "cells": len(data.cells),
        "skipped": data.skipped,
        "threshold": options.threshold,
        "answers": data.answers,
    }
    if outcome is not None:
        summary |= {"computed": outcome.computed, "resumed": outcome.resumed, "wall_s": outcome.wall_s}
    (store.folder / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    report.write_report(data, store.folder)
    for entry in data.skipped:
        print(f"skipped: {entry['reason']}", file=sys.stderr)
    if options.json:
        print(json.dumps(summary))
        return 0
    _print_answers(data.answers, options.threshold)
    took = f" in {outcome.wall_s:.1f} s" if outcome is not None else ""
    print(f"{len(data.cells)} cells{took}, pictures skipped: {len(data.skipped)}")
    print(f"open {summary['report']}")
    return 0


def _print_answers(found: list[dict[str, Any]], threshold: float) -> None:
    """One row per target and light, one column per velocity: the recommended exposure and the window."""
    from rich.console import Console
    from rich.table import Table

    velocities = list(dict.fromkeys((a["velocity_x_px_s"], a["velocity_y_px_s"]) for a in found))
    table = Table(
        title=f"Exposure to use, ms, and (range that keeps mean confidence >= {threshold:g}; < > reach the "
        "shortest or longest tested)",
        title_justify="left",
    )
    table.add_column("target")
    table.add_column("lux", justify="right")
    for x, y in velocities:
        table.add_column(f"{x:g} px/s" if y == 0 else f"({x:g}, {y:g}) px/s")
    rows: dict[tuple[str, float], dict[tuple[float, float], str]] = {}
    for answer in found:
        row = rows.setdefault((answer["group"], answer["illuminance_lux"]), {})
        row[answer["velocity_x_px_s"], answer["velocity_y_px_s"]] = _answer_text(answer)
    for (group, lux), row in rows.items():
        table.add_row(group, f"{lux:g}", *(row.get(velocity, "") for velocity in velocities))
    Console().print(table)


def _answer_text(answer: dict[str, Any]) -> str:
    if answer["recommended_s"] is None:
        return "none works"
    ends = [[f"{1e3 * low:.3g}", f"{1e3 * high:.3g}"] for low, high in answer["windows_s"]]
    ends[0][0] = ("<" if answer["open_low"] else "") + ends[0][0]
    ends[-1][1] = (">" if answer["open_high"] else "") + ends[-1][1]
    return f"{1e3 * answer['recommended_s']:g} ({', '.join('-'.join(pair) for pair in ends)})"


def _print_assumptions(contract: Any, model: Path | None) -> None:
    assumed = [name for name, source in contract.sources.items() if source.startswith("assumed")]
    if not assumed or model is None:
        return
    values = {name: getattr(contract, name) for name in assumed}
    values["classes"] = f"the {len(contract.classes)} of COCO"
    print(
        f"assumed, since nothing in {model.name} says it: "
        + ", ".join(f"{name} {values[name]}" for name in assumed)
        + f".\nState these in {model.with_suffix('.contract.json').name} beside it, or name a preset with "
        f"--contract {contract.family}.",
        file=sys.stderr,
    )


def _simulate(options: argparse.Namespace) -> int:
    camera = _camera(options)
    import torch

    from blurnoise.checks import non_negative
    from blurnoise.sensor import develop_8bit, photoelectrons
    from blurnoise.simulate import simulate
    from blurnoise_eval.datasets import decode, write_picture

    non_negative("seed", options.seed)
    exposure_s = options.exposure_ms / 1e3
    picture = decode(options.image)
    scene = torch.from_numpy(picture.astype("float32") / float(2 ** (8 * picture.itemsize) - 1))
    scene = scene[None, None] if scene.ndim == 2 else scene.permute(2, 0, 1)[None].contiguous()
    dn = simulate(
        scene,
        camera,
        exposure_s=exposure_s,
        illuminance_lux=options.lux,
        velocity_px_s=(options.dx, options.dy),
        temperature_c=options.temperature_c,
        generator=[options.seed],
    )
    native = options.bit_depth == "native"
    out = dn.to(torch.int32).numpy().astype("uint16") if native else develop_8bit(dn, camera).numpy()
    write_picture(options.output, out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0))
    facts = {
        "output": str(options.output),
        "camera": camera.name,
        "white_electrons": photoelectrons(camera, options.lux, exposure_s),
        "saturation_electrons": camera.saturation_e,
        "blur_px": (options.dx**2 + options.dy**2) ** 0.5 * exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": camera.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(camera.clip_dn)).float().mean()),
    }
    _print_facts(facts, options.json)
    return 0


def _motion(options: argparse.Namespace) -> int:
    from blurnoise.motion import blur_pixels, velocity_px_s

    speed_m_s = options.speed_kmh / 3.6
    camera = {"width_px": options.width_px, "hfov_deg": options.hfov_deg, "lens": options.lens}
    target = {"target_width_m": options.target_width_m}
    velocity = velocity_px_s(speed_m_s, options.distance_m, **target, **camera)
    length = blur_pixels(speed_m_s, options.distance_m, options.exposure_ms / 1e3, **target, **camera)
    _print_facts({"lens": options.lens, "velocity_px_s": velocity, "blur_px": length}, options.json)
    return 0


def _chart(options: argparse.Namespace) -> int:
    from blurnoise import charts
    from blurnoise.encoding import srgb_from_linear
    from blurnoise_eval.datasets import write_picture

    angle = options.angle if options.angle is not None else (5.0 if options.kind == "slanted-edge" else 0.0)
    size = {"height_px": options.height, "width_px": options.width}
    if options.kind == "slanted-edge":
        linear = charts.slanted_edge(options.height, options.width, angle_deg=angle)
    elif options.kind == "siemens-star":
        linear = charts.siemens_star(options.size, **size, angle_deg=angle)
    elif options.kind == "stop-sign":
        linear = charts.stop_sign(options.size, **size, angle_deg=angle)
    else:
        linear = charts.flat_patch(options.height, options.width)
    full_scale, dtype = (255, "uint8") if options.bit_depth == "8" else (65535, "uint16")
    coded = (
        srgb_from_linear(linear.double()).mul(full_scale).round()[0].permute(1, 2, 0).numpy().astype(dtype)
    )
    write_picture(options.output, coded[..., 0] if coded.shape[2] == 1 else coded)
    print(options.output)
    return 0


def _inspect(options: argparse.Namespace) -> int:
    from blurnoise_eval.onnx_model import Detector

    detector = Detector(options.model, contract=options.contract)
    contract = detector.contract
    facts = {
        "model": str(options.model),
        "sha256": detector.sha256,
        "inputs": [f"{value.name} {value.shape} {value.type}" for value in detector.session.get_inputs()],
        "outputs": [f"{value.name} {value.shape} {value.type}" for value in detector.session.get_outputs()],
        "metadata": sorted(detector.session.get_modelmeta().custom_metadata_map),
    }
    if options.json:
        print(json.dumps({**facts, "contract": contract.to_dict(), "assumed": contract.assumptions}))
        return 0
    _print_facts(facts, False)
    print("contract")
    for name, source in contract.sources.items():
        value = getattr(contract, name)
        if name == "classes":
            value = f"{len(value)}: {', '.join(value[:4])}{', ...' if len(value) > 4 else ''}"
        print(f"  {name:15s} {value!s:28s} {source}")
    _print_assumptions(contract, options.model)
    return 0


def _bench(options: argparse.Namespace) -> int:
    from blurnoise_eval import bench

    if options.what == "simulate":
        facts = bench.simulate_speed(_threads(options))
    else:
        import tempfile

        from blurnoise_eval.datasets import image_folder, rendered_signs

        with tempfile.TemporaryDirectory() as folder:
            pictures = image_folder(options.images) if options.images else rendered_signs()
            facts = bench.sweep_speed(
                _detector(options, Path(folder)), pictures, _threads(options), Path(folder)
            )
    _print_facts(facts, options.json)
    return 0


def _camera(options: argparse.Namespace) -> Camera:
    from dataclasses import replace

    from blurnoise.camera import Camera

    camera = Camera.preset(options.camera)
    if options.f_number is None:
        return camera
    sources = {**camera.sources, "f_number": "given on the command line"}
    return replace(camera, f_number=options.f_number, sources=sources)


def _detector(options: argparse.Namespace, folder: Path) -> Any:
    from blurnoise_eval.onnx_model import Detector

    if options.model is not None:
        return Detector(options.model, contract=options.contract)
    from blurnoise_models import matched_filter

    return Detector(matched_filter.build(folder / "matched_filter.onnx"), contract=options.contract)


def _pictures(options: argparse.Namespace) -> PictureSet:
    from blurnoise_eval import datasets

    if options.target and not options.coco:
        raise ValueError("target: goes with --coco, whose categories it names")
    if options.coco:
        pictures = datasets.coco(options.coco, images=options.images, labels=options.target)
    elif options.images:
        pictures = datasets.image_folder(options.images)
    else:
        pictures = datasets.rendered_signs()
    if options.limit is None:
        return pictures
    if options.limit < 1:
        raise ValueError(f"limit = {options.limit}: must be >= 1")
    return datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[: options.limit])


def _threads(options: argparse.Namespace) -> int:
    from blurnoise_eval.results import usable_cores

    threads = options.threads if options.threads is not None else usable_cores()
    if threads < 1:
        raise ValueError(f"threads = {threads}: must be >= 1")
    return int(threads)


def _print_facts(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(facts))
        return
    width = max(map(len, facts))
    for name, value in facts.items():
        for line in value if isinstance(value, list) else [value]:
            print(f"{name:{width}s}  {f'{line:.6g}' if isinstance(line, float) else line}")
            name = ""


class _Progress:
    """A progress bar on the terminal's error stream, silent where there is none."""

    def __init__(self, label: str, total: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

        columns = ("[bold]{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        console = Console(stderr=True)
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._progress.add_task(label, total=total)

    def __enter__(self) -> Any:
        self._progress.start()
        return lambda cells: self._progress.advance(self._task, cells)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


if __name__ == "__main__":
    sys.exit(main())
