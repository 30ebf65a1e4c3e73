"""A picture is taken: the camera is set, the light exposed, the frames developed; the figures of what happened."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import AutoExposure, ExposedScene, plan
from blurnoise._core.checks import in_range, integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.blur.layers import object_motion, seen_behind
from blurnoise.camera import Camera
from blurnoise.camera.captures import Capture, staggered, windows
from blurnoise.camera.radiometry import filter_electrons, photoelectrons
from blurnoise.camera.spectra import Curve, illuminant
from blurnoise.light.conditions import middle_of
from blurnoise.motion.trajectory import Trajectory
from blurnoise.picture.develop import in_channels
from blurnoise.scene import hdr
from blurnoise.scene.cutting import Cut
from blurnoise.scene.fusion import readers_of
from blurnoise.scene.hdr import Flicker
from blurnoise.scene.metering import mean_luma
from blurnoise.scene.plan import Plan
from blurnoise_eval.plan.axes import AUTOMATIC, AXES, EGO
from blurnoise_eval.plan.conditions import reflectance_text, with_lens
from blurnoise_eval.plan.files import SceneFile
from blurnoise_eval.simulation.light import flicker, flow, moving_parts


@dataclass(frozen=True)
class Shot:
    """How the camera is set, and what moves before it; flow_px_s: of each pixel, where a camera drives.

    first: the camera at the gain of the first capture. captures: with the gain that is set beside their own.
    """

    camera: Camera
    first: Camera
    exposure_s: float
    gain_db: float
    digital_db: float
    lux: float
    temperature_c: float
    illuminant: str | Curve
    captures: tuple[Capture, ...]
    lamp: Flicker | None
    path: Trajectory | None
    moving: Cut | None
    velocity_px_s: tuple[float, float]
    flow_px_s: Tensor | None

    @property
    def white_e(self) -> float:
        """Electrons of white."""
        all_light = photoelectrons(self.camera, self.lux, self.exposure_s, self.illuminant)
        return all_light * self.captures[0].sensitivity


@dataclass(frozen=True)
class Taken:
    """Pictures (H, W) or (H, W, 3), one or a raw one per capture; figures by name; what each stage contributes."""

    pictures: tuple[NDArray[Any], ...]
    figures: dict[str, Any]
    plan: Plan
    camera: Camera


def take(given: SceneFile, camera: Camera, scene: Tensor) -> Taken:
    """Take the picture of the light, as :func:`light` has it. Raises ``ValueError`` naming a field."""
    integer("seed", given.seed, 0, LAST_SEED)
    shot = _shot(given, camera, scene)
    exposed = ExposedScene(
        shot.moving.background if shot.moving else scene,
        illuminant=shot.illuminant,
        fidelity=given.fidelity,
        tolerance_dn=given.tolerance_dn,
        layers=shot.moving.layers if shot.moving else (),
    )
    frames = hdr.captured(
        exposed,
        shot.camera,
        shot.captures,
        exposure_s=shot.exposure_s,
        illuminance_lux=shot.lux,
        velocity_px_s=shot.velocity_px_s if shot.flow_px_s is None else shot.flow_px_s,
        trajectory=shot.path,
        temperature_c=shot.temperature_c,
        generator=[given.seed],
        flicker=shot.lamp,
    )
    outputs = _developed(given, shot, frames, scene.shape[1])
    pictures = tuple(out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0) for out in outputs)
    size = (scene.shape[-2], scene.shape[-1])
    found = _figures(shot, frames[0], size)
    if given.grey_anchor is not None or given.emitters is not None or given.picture_tone == "linear":
        found["above_white_percent"] = 100 * float((scene.amax(1) > 1).double().mean())
    found["reflectance"] = reflectance_text(given.grey_anchor, "--grey-anchor")
    return Taken(pictures, found, _plan(given, shot, size), shot.camera)


def _shot(given: SceneFile, camera: Camera, scene: Tensor) -> Shot:
    at, lit_by = given.at(), _illuminant(given.illuminant)
    lens = {each.into.partition(".")[2]: at[each.name] for each in AXES
            if each.into.startswith("camera.") and each.name in at}  # fmt: skip
    camera = with_lens(_rolling(given.line_time_us, camera), **lens)
    camera = camera.with_figures(
        sources={**camera.sources, **dict.fromkeys(lens, "given on the command line")}
    )
    if given.hdr is not None:
        camera = camera.with_figures(captures=_captures(given.hdr))
    velocity = (at["velocity_x_px_s"], at["velocity_y_px_s"])
    moving, velocity = moving_parts(given, scene, velocity)
    at |= _exposure_of(given, camera, scene, lit_by, at)
    captures, digital_db = hdr.amplified(camera, at["gain_db"])
    size = (scene.shape[-2], scene.shape[-1])
    path = None
    if given.trajectory is not None:
        path = given.trajectory.of(camera, size, at["exposure_s"], given.seed)
    return Shot(
        camera=camera,
        first=readers_of(camera, captures)[0],
        exposure_s=at["exposure_s"],
        gain_db=at["gain_db"],
        digital_db=digital_db,
        lux=at["illuminance_lux"],
        temperature_c=at["temperature_c"],
        illuminant=lit_by,
        captures=captures,
        lamp=flicker(given, scene),
        path=path,
        moving=moving,
        velocity_px_s=velocity,
        flow_px_s=flow(given, camera, size, at.get(EGO.name), velocity),
    )


def _exposure_of(
    given: SceneFile, camera: Camera, scene: Tensor, lit_by: str | Curve, at: dict[str, float]
) -> dict[str, float]:
    """Time and gain, where the camera sets them."""
    if at["exposure_s"] == AUTOMATIC and at["gain_db"] not in (0.0, AUTOMATIC):
        raise ValueError(
            f"gain_db = {at['gain_db']:g}: needs a fixed exposure; an automatic exposure sets the gain, too"
        )
    if AUTOMATIC not in (at["exposure_s"], at["gain_db"]):
        return {}
    exposure_s, gain_db, _ = (given.auto_exposure or AutoExposure()).setting(
        camera,
        exposure_s=None if at["exposure_s"] == AUTOMATIC else at["exposure_s"],
        mean_light=float(mean_luma(scene, camera, lit_by)[0]),
        illuminance_lux=at["illuminance_lux"],
        temperature_c=at["temperature_c"],
        illuminant=lit_by,
    )
    return {"exposure_s": exposure_s, "gain_db": gain_db}


def _developed(given: SceneFile, shot: Shot, frames: list[Tensor], channels: int) -> list[NDArray[Any]]:
    if given.bit_depth == "native":
        return [each.to(torch.int32).numpy().astype("uint16") for each in frames]
    seen = hdr.merged(
        frames,
        shot.camera,
        shot.captures,
        white_e=torch.tensor([shot.white_e * in_range("hdr_white", given.hdr_white, 1e-6, 1e6)]),
        digital_db=shot.digital_db,
        illuminant=shot.illuminant,
        eight_bit=True,
    )
    return [in_channels(seen, max(seen.shape[1], channels)).numpy()]


def _figures(shot: Shot, dn: Tensor, size: tuple[int, int]) -> dict[str, Any]:
    """Of the first frame, by name; where a camera drives, the blur is the median of the places'."""
    camera, first = shot.camera, shot.first
    speeds = None if shot.flow_px_s is None else shot.flow_px_s.square().sum(0).sqrt()
    speed_px_s = hypot(*shot.velocity_px_s) if speeds is None else float(speeds.median())
    found: dict[str, Any] = {
        "camera": camera.name,
        "exposure_ms": 1e3 * shot.exposure_s,
        "gain_db": shot.gain_db,
        "white_electrons": shot.white_e,
        "saturation_electrons": first.sensor.saturation_e,
        "blur_px": speed_px_s * shot.exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": camera.sensor.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(first.sensor.saturated_dn)).float().mean()),
    }
    if speeds is not None:
        found["longest_blur_px"] = float(speeds.max()) * shot.exposure_s
    if camera.sensor.row_time_s:
        found["readout_ms"] = 1e3 * camera.sensor.row_time_s * size[0] / camera.field.per_sensor_px(size)
    if camera.sensor.cfa != "none":
        found["cfa"] = camera.sensor.cfa
        per_lux_s = filter_electrons(camera, shot.illuminant)
        found |= {
            f"white_electrons_{each}": e * shot.lux * shot.exposure_s for each, e in per_lux_s.items() if each
        }
    if len(shot.captures) > 1:
        found["captures"] = len(shot.captures)
        found["fused_saturation_electrons"] = hdr.saturations_e(camera, shot.captures)[-1]
        found["dynamic_range_db"] = hdr.dynamic_range_db(camera, shot.captures)
    if shot.moving:
        found |= _of_object(shot, shot.moving, size)
    if shot.lamp:
        found["pwm_phase"] = shot.lamp.pwm.phase
        for place, (_, taken_s) in enumerate(windows(shot.captures, shot.exposure_s), 1):
            suffix = "" if place == 1 else f"_{place}"
            found[f"pwm_dark_percent{suffix}"] = 100 * shot.lamp.pwm.dark_probability(taken_s)
    return found


def _of_object(shot: Shot, moving: Cut, size: tuple[int, int]) -> dict[str, Any]:
    """How far it moves, and how much of what is seen in its place was invented."""
    (layer,), behind = moving.layers, shot.velocity_px_s
    own = tuple(float(each) for each in layer.velocity_px_s)
    if shot.flow_px_s is not None:  # as it is on average behind the object
        left, top = layer.place_px
        part = shot.flow_px_s[:, max(0, top) :, max(0, left) :]
        part = part[..., : len(layer.alpha), : layer.alpha.shape[1]]
        behind = (float(part[0].mean()), float(part[1].mean()))
    apart = [(each - rest) * shot.exposure_s for each, rest in zip(own, behind, strict=True)]
    invented = seen_behind(layer, [(layer, apart)], size) if moving.invented.any() else 0.0
    return {"object_blur_px": hypot(*own) * shot.exposure_s, "invented_percent": 100 * invented}


def _plan(given: SceneFile, shot: Shot, size: tuple[int, int]) -> Plan:
    """What each stage contributes."""
    motion_px = torch.tensor(shot.velocity_px_s, dtype=torch.float64) * shot.exposure_s
    varies_px = 0.0
    if shot.flow_px_s is not None:
        middle, farthest = middle_of(shot.flow_px_s[None] * shot.exposure_s)
        motion_px, varies_px = middle[0], float(farthest)
    layers = shot.moving.layers if shot.moving else ()
    return plan(
        shot.first,
        exposure_s=shot.exposure_s,
        illuminance_lux=shot.lux,
        displacement_px=(float(motion_px[0]), float(motion_px[1])),
        variation_px=varies_px,
        trajectory=shot.path,
        temperature_c=shot.temperature_c,
        illuminant=shot.illuminant,
        tolerance_dn=given.tolerance_dn,
        objects=tuple(object_motion(layer, shot.exposure_s, size) for layer in layers),
        size=size,
    )


def _illuminant(name: str) -> str | Curve:
    """The spectrum of a name, checked, or of a CSV file."""
    if name.lower().endswith(".csv"):
        return Curve.from_csv(name)
    illuminant(name)
    return name


def _captures(ratios: str) -> tuple[Capture, ...]:
    """One, and shorter ones by their ratios: "16" or "16,256"."""
    try:
        return staggered(*(float(part) for part in ratios.split(",")))
    except ValueError as error:
        raise ValueError(f"hdr = {ratios!r}: must be RATIO[,RATIO], such as 16 or 16,256 ({error})") from None


def _rolling(line_time_us: float | None, camera: Camera) -> Camera:
    """The camera with another line time, 0 for a global shutter; as it is where none is given."""
    if line_time_us is None:
        return camera
    in_range("line_time_us", line_time_us, 0.0, 1e6)
    rolls = "rolling" if camera.sensor.shutter == "global" else camera.sensor.shutter
    return camera.with_figures(row_time_s=line_time_us / 1e6, shutter=rolls if line_time_us else "global")
