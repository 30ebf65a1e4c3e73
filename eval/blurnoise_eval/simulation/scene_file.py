"""A scene file as scene and exposure: the light of its picture, the camera, and what moves.

Light is linear, (1, C, H, W), 1 is white; times in s, motion in px/s, right and down.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise import AutoExposure, Exposure, Scene
from blurnoise._core.checks import in_range, integer, limited
from blurnoise._core.rng import LAST_SEED
from blurnoise.camera import Camera
from blurnoise.camera.captures import Capture, staggered
from blurnoise.light.headlamps import Headlamps
from blurnoise.light.headlit import HeadlitPicture, HeadlitTarget, Outline, headlit
from blurnoise.light.lamp import Pwm
from blurnoise.light.road_objects import RoadObject
from blurnoise.scene.cutting import Cut, Matte, cut_out
from blurnoise.scene.metering import anchored, mean_luma
from blurnoise.scene.scene import scene_reflectance
from blurnoise_eval.datasets import decode, decode_any, segmentation, unit
from blurnoise_eval.plan.axes import AXES, EGO, GAIN, HEADLAMP
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.files import SceneFile
from blurnoise_eval.plan.lamps import emitters_of, pwm_of
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.headlit_scenes import headlit_layers

_LENS = {axis.name: axis.into.partition(".")[2] for axis in AXES if axis.into.startswith("camera.")}


class Opened(NamedTuple):
    """The scene and the exposure of a file; its object, cut out of the picture, or None, and in headlamps."""

    scene: Scene
    exposure: Exposure
    cut: Cut | None
    headlit: HeadlitTarget | None = None


def opened(config: SceneFile, light: Tensor, camera: Camera) -> Opened:
    """Scene and exposure of a file, of its picture's ``light`` (:func:`light_of`). Raises ``ValueError``."""
    integer("seed", config.seed, 0, LAST_SEED)
    at, size = Conditions(**config.at()), (light.shape[-2], light.shape[-1])
    _check_motion(config, at)
    config.check_headlamps(config.emitters)
    exposure = at.exposure(
        _camera(config, camera),
        config.seed,
        vehicle=config.vehicle,
        spectrum=config.own_spectrum,
        infrared=config.infrared,
    )
    cut = _cut(config, light)
    lit = _headlit(config, light, exposure, cut)
    exposure = exposure if lit else replace(exposure, headlamp="off")
    if at.automatic:
        seen = light if lit is None else light * (1 + lit.plane() / exposure.illuminance_lux)
        exposure = _automatic(config, at, exposure).metered(
            float(mean_luma(seen, exposure.camera, exposure.illuminant)[0])
        )
    if config.trajectory is not None:
        along = config.trajectory.of(exposure.camera, size, exposure.exposure_s, config.seed)
        exposure = replace(exposure, trajectory=along)
    lamp, mask = _lamp(config, size)
    planes = dict[str, Tensor]()
    if lit is not None and cut is not None:
        beam = exposure.headlamp
        planes = {beam: lit.plane(but=[0])}
        cut = cut._replace(layers=tuple(headlit_layers(cut.layers, [0], lit, beam)))
    scene = Scene(
        cut.background if cut else light,
        layers=cut.layers if cut else (),
        lamp_mask=mask,
        headlamp_lux=planes,
    )
    return Opened(scene, replace(exposure, lamp=lamp), cut, lit.targets[0] if lit else None)


def _headlit(config: SceneFile, light: Tensor, exposure: Exposure, cut: Cut | None) -> HeadlitPicture | None:
    """The object in the light of headlamps, at its stated distance; None without headlamps, and where those of a
    named light have nothing to light.

    Its class is not known, so that the picture says how high it stands, and the file what covers it.
    """
    if exposure.headlamp == "off":
        return None
    if cut is None or config.lit.distance_m is None:
        if not any(config.values(HEADLAMP.name)):
            return None
        raise ValueError("headlamp: needs labels, by which targets are known; or distance_m with --object")
    ((left, top), (height, width)) = cut.layers[0].place_px, cut.layers[0].alpha.shape
    alpha = cut.layers[0].alpha.numpy().astype("float32")
    box = (float(left), float(top), float(left + width), float(top + height))
    view = config.lit.view(exposure.camera, config.vehicle)
    # Any width: the distance is stated, and base_m=None lets the picture say how high it stands.
    own = {"object": RoadObject(width_m=1.0, base_m=None, sheeting=config.lit.sheeting)}
    outline = Outline("object", box, alpha, (left, top), outlined=True)
    lamps = Headlamps(exposure.headlamp)  # type: ignore[arg-type]  # a beam's name
    return headlit(light, [outline], replace(view, own=own), lamps)


def light_of(image: Path, config: SceneFile) -> Tensor:
    """A picture's linear light (1, C, H, W), 1 is white, by its tone curve, grey anchor and emitters.

    Floats are light, whatever the tone curve.
    """
    stored = decode_any(image)
    linear = config.picture_tone == "linear" or stored.dtype.kind == "f"
    light = torch.from_numpy(unit(stored))
    light = light[None, None] if light.ndim == 2 else light.permute(2, 0, 1)[None].contiguous()
    light = anchored(
        light if linear else scene_reflectance(light, config.picture_tone or "srgb"), config.grey_anchor
    )
    if config.emitters is None:
        return light
    path, times = emitters_of(config.emitters)
    return light * (1 + _mask(Path(path), (light.shape[-2], light.shape[-1])) * (times - 1))


def _camera(config: SceneFile, camera: Camera) -> Camera:
    """The camera with the file's line time, captures, and the sources of what the file sets."""
    if config.line_time_us is not None:  # 0: a global shutter
        in_range("line_time_us", config.line_time_us, 0.0, 1e6)
        rolls = "rolling" if camera.sensor.shutter == "global" else camera.sensor.shutter
        shutter = rolls if config.line_time_us else "global"
        camera = camera.with_figures(row_time_s=config.line_time_us / 1e6, shutter=shutter)
    stated = [_LENS[name] for name in config.at() if name in _LENS]
    camera = replace(camera, sources={**camera.sources, **dict.fromkeys(stated, "given on the command line")})
    return camera if config.hdr is None else camera.with_figures(captures=_captures(config.hdr))


def _automatic(config: SceneFile, at: Conditions, exposure: Exposure) -> Exposure:
    """The exposure with an auto-exposure for what the file leaves to the camera."""
    time = at.exposure_s == AUTOMATIC
    if time and GAIN.name in config.grid and at["gain_db"] != AUTOMATIC:
        raise ValueError(
            f"gain_db = {at['gain_db']:g}: needs a fixed exposure; an automatic exposure sets the gain, too"
        )
    exposure_s = math.nan if time else exposure.exposure_s
    return replace(exposure, exposure_s=exposure_s, gain_db=config.auto_exposure or AutoExposure())


def _check_motion(config: SceneFile, at: Conditions) -> None:
    """Raise ``ValueError`` for settings of motion that lack another, or that exclude each other."""
    moving = {"object_dx": config.object_dx, "object_dy": config.object_dy}
    alone = {**moving, "plate": config.plate, "moves": config.moving != "all"}
    if config.object is None and (lone := [name for name, value in alone.items() if value]):
        raise ValueError(f"{', '.join(lone)}: needs --object, the part that moves")
    for name, px_s in moving.items():
        limited(name, px_s, "velocity_px_s")
    if config.moving != "all" and any(moving.values()):
        raise ValueError(
            "object_dx, object_dy: cannot be combined with moves, by which dx and dy move one part"
        )
    if at[EGO.name] is None and config.vehicle is not None and not config.beams:
        raise ValueError("vehicle: needs ego_kmh, its speed, or headlamp")
    if at[EGO.name] is not None and any(at.displacement_px):
        raise ValueError("ego_kmh: cannot be combined with dx and dy, which move the whole picture alike")


def _cut(config: SceneFile, light: Tensor) -> Cut | None:
    """The object cut out of the picture: a target that moves by dx and dy, or a layer with a velocity of its own."""
    if config.object is None:
        return None
    behind = None
    if config.plate is not None:
        if config.grey_anchor or config.emitters:
            raise ValueError(
                "plate: cannot be combined with grey_anchor or emitters, which change the picture's light alone"
            )
        behind = light_of(Path(config.plate), config)
        if behind.shape != light.shape:
            sizes = f"{tuple(behind.shape)}, {tuple(light.shape)}"
            raise ValueError(f"{config.plate}: a plate must have the size of its picture; they are {sizes}")
    matte = _matte(config.object, (light.shape[-2], light.shape[-1]))
    cut = cut_out(light, [matte], [(config.object_dx, config.object_dy)], behind)
    if config.moving == "all":
        return cut
    return cut._replace(layers=tuple(replace(layer, speed=1.0) for layer in cut.layers))


def _lamp(config: SceneFile, size: tuple[int, int]) -> tuple[Pwm | None, Tensor | None]:
    """The lamp of "HZ,DUTY[,PHASE]", a missing phase drawn with the seed, and the pixels (H, W) that it lights."""
    if config.pwm is None:
        if config.pwm_mask is not None:
            raise ValueError("pwm_mask: needs pwm, the pulses of its lamp")
        return None, None
    lamp, has_phase = pwm_of(config.pwm)
    lamp = lamp if has_phase else lamp.with_phase_of(config.seed)
    return lamp, None if config.pwm_mask is None else _mask(Path(config.pwm_mask), size)


def _shares(path: Path) -> Tensor:
    """A picture's codes as shares of the largest."""
    return torch.from_numpy(unit(decode(path)))


def _mask(path: Path, size: tuple[int, int]) -> Tensor:
    """A picture of that size (H, W) as shares (H, W), white being 1."""
    shares = _shares(path)
    shares = shares if shares.ndim == 2 else shares.mean(-1)
    if shares.shape != size:
        sizes = " and ".join(f"{width} x {height}" for height, width in (shares.shape, size))
        raise ValueError(f"{path}: a mask must have the size of its picture; they are {sizes} px")
    return shares


def _matte(where: str, size: tuple[int, int]) -> Matte:
    """Where an object is in a picture (H, W): "mask.png" or "x,y,width,height"."""
    box = _numbers(where)
    if box and len(box) != 4:
        raise ValueError(f"object = {where!r}: must be MASK.png or X,Y,WIDTH,HEIGHT")
    matte: Matte = (
        segmentation.of_box(box[0], box[1], box[2], box[3], size) if box else _mask(Path(where), size).numpy()
    )
    if not matte.any():
        raise ValueError(f"object = {where!r}: covers no pixel of the picture")
    return matte


def _numbers(text: str) -> list[float]:
    """The numbers of "1,2.5"; [] for another text."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


def _captures(ratios: str) -> tuple[Capture, ...]:
    """One capture, and shorter ones by their ratios: "16" or "16,256"."""
    try:
        return staggered(*(float(part) for part in ratios.split(",")))
    except ValueError as error:
        raise ValueError(f"hdr = {ratios!r}: must be RATIO[,RATIO], such as 16 or 16,256 ({error})") from None
