"""What the options of a command name: a camera, a plan, models, pictures, threads."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from blurnoise_eval.cli._options import MODEL_TIMEOUT_S
from blurnoise_eval.system.terminal import say_wrapped

if TYPE_CHECKING:
    from torch import Tensor

    from blurnoise.motion.ego import Lens, Vehicle
    from blurnoise.motion.trajectory import Trajectory
    from blurnoise.optics.camera import Camera, Capture
    from blurnoise.optics.colour import Cfa
    from blurnoise.optics.spectra import Curve
    from blurnoise.scene.cutting import Cut, Matte
    from blurnoise.scene.hdr import Flicker
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.grid.objects import Objects
    from blurnoise_eval.scoring.on_picture import Model
    from blurnoise_eval.system.storage import Location


def camera(
    name: str | None, f_number: float | None = None, cfa: Cfa | None = None, *, colour: bool = True
) -> Camera:
    """The camera of a preset's name or a file, with the lens's f-number (light and diffraction) and the colour
    filters if these are given; without a name the default for pictures in colour or grey."""
    from dataclasses import replace

    from blurnoise_eval.drawing.photon_transfer import find
    from blurnoise_eval.grid.conditions import with_lens
    from blurnoise_eval.sweep.default_camera import default_camera

    camera = default_camera(colour=colour, cfa=cfa) if name is None else find(name)
    stated = "given on the command line"
    if cfa is not None:
        camera = replace(camera, cfa=cfa, sources={**camera.sources, "cfa": stated})
    if f_number is not None:
        sources = {**camera.sources, "f_number": stated}
        camera = replace(with_lens(camera, f_number=f_number), sources=sources)
    return camera


def camera_of_run(
    name: str | None, models: Sequence[Model], pictures: PictureSet, cfa: Cfa | None = None
) -> tuple[Camera, str | None]:
    """The camera that is named, or the default of these models and pictures; and what the terminal says of it."""
    from blurnoise_eval.sweep.default_camera import camera_text, default_for, in_colour

    chosen = default_for(models, pictures, cfa) if name is None else camera(name, cfa=cfa)
    return chosen, camera_text(chosen, colour=chosen.cfa != "none" or in_colour(pictures))


def illuminant(name: str) -> str | Curve:
    """The spectrum of a name, checked, or of a CSV file."""
    from blurnoise.optics.spectra import Curve, illuminant

    if name.lower().endswith(".csv"):
        return Curve.from_csv(name)
    illuminant(name)
    return name


def light(
    image: Path, encoding: Literal["srgb", "linear"], grey_anchor: str | None, emitters: str | None
) -> Tensor:
    """A picture's linear light (1, C, H, W), 1 is white; emitters: "mask.png:FACTOR", times which the masked is."""
    import torch

    from blurnoise._core.checks import in_range
    from blurnoise.scene.metering import anchored
    from blurnoise.scene.scene import scene_reflectance
    from blurnoise_eval.datasets import decode, decode_linear

    if encoding == "linear":
        scene = torch.from_numpy(decode_linear(image))
    else:
        stored = decode(image)
        scene = torch.from_numpy(stored.astype("float32") / float(2 ** (8 * stored.itemsize) - 1))
    scene = scene[None, None] if scene.ndim == 2 else scene.permute(2, 0, 1)[None].contiguous()
    scene = anchored(scene if encoding == "linear" else scene_reflectance(scene, "srgb"), grey_anchor)
    if emitters is None:
        return scene
    mask_path, colon, factor = emitters.rpartition(":")
    try:
        times = float(factor)
    except ValueError:
        colon = ""
    if not colon or not mask_path:
        raise ValueError(f"emitters = {emitters!r}: must be MASK.png:FACTOR")
    return scene * (
        1 + mask(Path(mask_path), scene.shape) * (in_range("emitters: factor", times, 0.0, 1e6) - 1)
    )


def mask(path: Path, size: tuple[int, ...]) -> Tensor:
    """A picture of that size (..., H, W) as shares (H, W), white being 1."""
    import torch

    from blurnoise_eval.datasets import decode

    stored = decode(path)
    shares = torch.from_numpy(stored.astype("float32") / float(2 ** (8 * stored.itemsize) - 1))
    shares = shares if shares.ndim == 2 else shares.mean(-1)
    if shares.shape != size[-2:]:
        sizes = " and ".join(f"{width} x {height}" for height, width in (shares.shape, size[-2:]))
        raise ValueError(f"{path}: a mask has its picture's size; they are {sizes} px")
    return shares


def cut_out(
    where: str,
    plate: Path | None,
    light: Tensor,
    velocity_px_s: tuple[float, float],
    encoding: Literal["srgb", "linear"],
) -> Cut:
    """An object of the light (1, C, H, W) as a layer, "mask.png" or "x,y,width,height", and what is behind it.

    plate: the scene without it; without it, that is invented.
    """
    from blurnoise.scene import cutting

    found = matte(where, (light.shape[-2], light.shape[-1]))
    behind = None if plate is None else _as(light, plate, encoding)
    return cutting.cut_out(light, [found], [velocity_px_s], behind)


def matte(where: str, size: tuple[int, int]) -> Matte:
    """Of an object in a picture (H, W), "mask.png" or "x,y,width,height"."""
    from blurnoise.scene import cutting

    try:
        numbers = [float(part) for part in where.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 4:
        x, y, width, height = numbers
        found = cutting.of_box(x, y, width, height, size)
    elif numbers:
        raise ValueError(f"object = {where!r}: must be MASK.png or X,Y,WIDTH,HEIGHT")
    else:
        found = mask(Path(where), size).numpy()
    if not found.any():
        raise ValueError(f"object = {where!r}: covers nothing of the picture")
    return found


def _as(scene: Tensor, path: Path, encoding: Literal["srgb", "linear"]) -> Tensor:
    found = light(path, encoding, None, None)
    if found.shape != scene.shape:
        raise ValueError(
            f"{path}: a plate is its picture's twin; they are {tuple(found.shape)}, {tuple(scene.shape)}"
        )
    return found


def captures(ratios: str | None, camera: Camera) -> tuple[Capture, ...]:
    """The camera's or one, unless ratios say what shorter ones there are: "16" or "16,256"."""
    from blurnoise.optics.camera import staggered

    if ratios is None:
        return camera.captures or staggered()
    try:
        return staggered(*(float(part) for part in ratios.split(",")))
    except ValueError as error:
        raise ValueError(f"hdr = {ratios!r}: must be RATIO[,RATIO], such as 16 or 16,256 ({error})") from None


def flicker(pwm: str | None, mask_path: Path | None, light: Tensor, seed: int) -> Flicker | None:
    """A lamp "HZ,DUTY[,PHASE]", where the mask says; a phase that is not given is drawn from the seed."""
    from blurnoise.light.flicker import Pwm
    from blurnoise.scene.hdr import Flicker

    if pwm is None:
        if mask_path is not None:
            raise ValueError("pwm-mask: goes with --pwm, whose lamp it shows")
        return None
    try:
        numbers = [float(part) for part in pwm.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise ValueError(f"pwm = {pwm!r}: must be HZ,DUTY or HZ,DUTY,PHASE, such as 90,0.1")
    try:
        lamp = Pwm(*numbers)
    except ValueError as error:
        raise ValueError(f"pwm = {pwm!r}: {error}") from None
    lamp = lamp if len(numbers) == 3 else lamp.with_phase_of(seed)
    return Flicker(lamp, None if mask_path is None else mask(mask_path, light.shape))


def trajectory(
    text: str | None, camera: Camera, light: Tensor, exposure_s: float, seed: int
) -> Trajectory | None:
    """As :mod:`blurnoise.motion.causes` has it, for a picture's exposure."""
    from blurnoise_eval.grid.trajectory_spec import TrajectorySpec

    size = (light.shape[-2], light.shape[-1])
    return None if text is None else TrajectorySpec.parse(text).of(camera, size, exposure_s, seed)


def rolling(line_time_us: float | None, camera: Camera) -> Camera:
    """The camera with another line time, 0 for a global shutter; as it is where none is given."""
    from dataclasses import replace

    if line_time_us is None:
        return camera
    shutter: Literal["global", "rolling", "global-reset"] = (
        "rolling" if camera.shutter == "global" else camera.shutter
    )
    return replace(camera, row_time_s=line_time_us / 1e6, shutter=shutter if line_time_us else "global")


def detector(model: Path | None, contract: str | None) -> Detector:
    """The user's model, or the built-in detector."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.detector import Detector

    return Detector(model or STOP_SIGN, contract=contract)


def models(
    paths: Sequence[Location] = (),
    contracts: Sequence[str] = (),
    *,
    ocr: Literal["crop", "find"] | None = None,
    dictionary: Location | None = None,
    text_detector: Location | None = None,
    timeout_s: float = MODEL_TIMEOUT_S,
) -> list[Model]:
    """The user's detectors and text recognisers, or the built-in detector. Equal names get a number.

    Raises ``ValueError`` where detectors and recognisers are named together: their targets differ.
    """
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.opening import open_models

    if ocr:
        if paths or text_detector or dictionary:
            raise ValueError(
                "ocr: brings its own models; leave out --model, --text-detector and --dictionary"
            )
        finder, recogniser = _packaged()
        paths, text_detector = [recogniser], finder if ocr == "find" else None
    stated: list[str | None] = [*contracts] or [None]
    further: Any = {"dictionary": dictionary, "text_detector": text_detector, "timeout_s": timeout_s}
    return list(open_models(paths or [STOP_SIGN], stated, **further))


def _packaged() -> tuple[Path, Path]:
    """Text detector and recogniser of the package rapidocr."""
    from blurnoise_eval.detectors.ocr import rapidocr_models

    found = rapidocr_models()
    if found is None:
        raise ValueError("ocr: needs the package rapidocr: pip install --no-deps rapidocr")
    return found


def read(models: Sequence[Model]) -> bool:
    """Whether these read text."""
    from blurnoise_eval.detectors.detector import Detector

    return not isinstance(models[0], Detector)


def pictures(
    *,
    images: Location | None = None,
    coco: Location | None = None,
    yolo: Location | None = None,
    split: str | None = None,
    bdd: Location | None = None,
    text: Location | None = None,
    targets: Sequence[str] = (),
    keep_empty: bool = False,
    limit: int | None = None,
    max_megapixels: float = 100.0,
    reads: bool = False,
) -> PictureSet:
    """A labelled set's, a folder's, or rendered signs; the first ``limit`` of them.

    reads: text. A picture of more than ``max_megapixels`` cannot be loaded. Notes of the set are written to standard
    error. Raises ``ValueError`` for what does not go together.
    """
    from dataclasses import replace

    from blurnoise._core.checks import in_range
    from blurnoise_eval import datasets

    in_range("max-megapixels", max_megapixels, 1e-6, datasets.MOST_MEGAPIXELS)
    largest: Any = {"max_megapixels": max_megapixels}
    chosen: Any = {"images": images, "labels": targets, "keep_empty": keep_empty}
    if limit is not None and limit < 1:
        raise ValueError(f"limit = {limit}: must be >= 1")
    sets = {"coco": coco, "yolo": yolo, "bdd": bdd, "text": text}
    sources = [name for name, path in sets.items() if path]
    if len(sources) > 1:
        raise ValueError(f"--{' and --'.join(sources)}: must be one of them")
    if targets and (not sources or text):
        raise ValueError("target: goes with --coco, --yolo or --bdd, whose classes it names")
    if keep_empty and not targets:
        raise ValueError("keep-empty: goes with --target; without it, pictures of nothing count anyway")
    if split and not yolo:
        raise ValueError("split: goes with --yolo, whose data.yaml names it")
    if reads and sources and not text:
        raise ValueError(
            f"{sources[0]}: text recognisers take --text, which says what is to be read, or --images"
        )
    if coco:
        found = datasets.coco(coco, **largest, **chosen)
    elif yolo:
        found = datasets.yolo(yolo, split=split, **largest, **chosen)
    elif bdd:
        found = datasets.bdd(bdd, **largest, **chosen)
    elif text:
        found = datasets.texts(text, images=images, **largest)
    elif images:
        found = datasets.image_folder(images, **largest)
    else:
        found = datasets.rendered_texts() if reads else datasets.rendered_signs()
    for note in found.notes:
        say_wrapped(f"{found.source}: {note}.", hanging=2, error=True)
    return replace(found, pictures=found.pictures[:limit])


def subject(
    *,
    model: Sequence[Location] | None,
    contract: Sequence[str] | None,
    ocr: Literal["crop", "find"] | None,
    dictionary: Location | None,
    text_detector: Location | None,
    model_timeout_s: float,
    target: Sequence[str] | None,
    **sets: Any,
) -> tuple[list[Model], PictureSet]:
    """Models and pictures as a sweep's options name them; sets: the other arguments of :func:`pictures`."""
    opened = models(
        model or (),
        contract or (),
        ocr=ocr,
        dictionary=dictionary,
        text_detector=text_detector,
        timeout_s=model_timeout_s,
    )
    return opened, pictures(targets=target or (), reads=read(opened), **sets)


def objects(
    mattes: str,
    plates: Location | None,
    speeds: Sequence[str],
    boxes: str,
    *,
    kmh: Sequence[str] = (),
    away_m: Sequence[str] = (),
    width_m: Sequence[str] = (),
    hfov_deg: float | None = None,
    lens: Lens | None = None,
) -> Objects:
    """What moves for itself; speeds: "CLASS=FACTOR" each; kmh, away_m, width_m: "CLASS=NUMBER[,...]" each."""
    from blurnoise_eval.grid.objects import Crossing, Objects

    told = _by_class("object-speed", speeds, "CLASS=FACTOR, such as car=0.5")
    crossing, away, wide = (
        _by_class(
            name, [part for text in stated for part in text.split(",")], f"CLASS={unit}, such as {such}"
        )
        for name, stated, unit, such in (
            ("object-kmh", kmh, "KMH", "car=50,person=5"),
            ("object-m", away_m, "M", "car=20"),
            ("object-width-m", width_m, "M", "car=4.5"),
        )
    )
    if lost := sorted({*away, *wide} - {*crossing}):
        raise ValueError(f"object-m, object-width-m: {', '.join(lost)}: go with --object-kmh of the class")
    crossings = {}
    for label, speed in crossing.items():
        seen_by = {"hfov_deg": hfov_deg, "lens": lens} if label in away else {}
        try:
            crossings[label] = Crossing(speed, wide.get(label), away.get(label), **seen_by)  # type: ignore[arg-type]
        except ValueError as error:
            why = str(error).removeprefix("object-kmh: ")
            raise ValueError(f"object-kmh: {label}: {why}") from None
    return Objects(mattes, told, None if plates is None else str(plates), boxes, crossings)


def _by_class(name: str, stated: Iterable[str], wanted: str) -> dict[str, float]:
    """Numbers by class, of "CLASS=NUMBER" each. Raises ``ValueError`` naming the option."""
    told = {}
    for text in stated:
        label, _, number = text.strip().rpartition("=")
        if label in told:
            raise ValueError(f"{name}: {label}: stated twice; must be once")
        try:
            told[label] = float(number)
        except ValueError:
            label = ""
        if not label:
            raise ValueError(f"{name} = {text!r}: must be {wanted}")
    return told


def vehicle(*, drives: bool, **fields: Any) -> Vehicle | None:
    """As :func:`blurnoise_eval.cli.vehicle.stated`. Raises ``ValueError`` for fields where nothing drives."""
    from blurnoise_eval.cli.vehicle import stated

    for name, value in fields.items():
        if value is not None and not drives:
            raise ValueError(f"{name}: goes with --ego-kmh")
    return stated(**fields)


def command() -> str:
    """What was typed, without what URLs hold of passwords."""
    from blurnoise_eval.system.transport import without_secrets

    return without_secrets(" ".join(["blurnoise", *sys.argv[1:]]))


def cache(limit_gb: float | None) -> None:
    """Bound this machine's cache, for the processes that are begun, too. Raises ``ValueError`` as that does."""
    from blurnoise_eval.system import node_cache

    if limit_gb is not None:
        node_cache.most_bytes(str(limit_gb))
        os.environ[node_cache.LIMIT_GB] = str(limit_gb)


def threads(count: int | None) -> int:
    """As many as asked for, else one per usable core. Raises ``ValueError`` below 1."""
    from blurnoise_eval.system.machine import usable_cores

    count = count if count is not None else usable_cores()
    if count < 1:
        raise ValueError(f"threads = {count}: must be >= 1")
    return count
