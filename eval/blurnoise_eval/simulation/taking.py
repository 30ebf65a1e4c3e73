"""A picture is taken: the camera is set, the light exposed, the frames developed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import AutoExposure, ExposedScene
from blurnoise._core.checks import in_range, integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.optics.camera import Camera, Capture, staggered
from blurnoise.optics.spectra import Curve, illuminant
from blurnoise.picture.develop import develop_8bit, in_channels
from blurnoise.scene.hdr import captured, developed, fuse
from blurnoise.scene.metering import mean_luma
from blurnoise.scene.plan import Plan
from blurnoise_eval.grid.axes import AXES, EGO
from blurnoise_eval.grid.conditions import with_lens
from blurnoise_eval.grid.scene_file import SceneFile
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.grid.values import AUTOMATIC
from blurnoise_eval.simulation.figures import Shot, figures, plan_of
from blurnoise_eval.simulation.light import flicker, flow, moving_parts


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
    frames = captured(
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
    outputs = _developed(given, shot, frames)
    pictures = tuple(out[0, 0] if len(out[0]) == 1 else out[0].transpose(1, 2, 0) for out in outputs)
    return Taken(pictures, figures(given, shot, frames), plan_of(given, shot), shot.camera)


def _shot(given: SceneFile, camera: Camera, scene: Tensor) -> Shot:
    at, lit_by = given.at(), _illuminant(given.illuminant)
    figures = {each.into.partition(".")[2]: at[each.name] for each in AXES
               if each.into.startswith("camera.") and each.name in at}  # fmt: skip
    stated = dict.fromkeys(figures, "given on the command line")
    camera = replace(
        with_lens(_rolling(given.line_time_us, camera), **figures), sources={**camera.sources, **stated}
    )
    velocity = (at["velocity_x_px_s"], at["velocity_y_px_s"])
    moving, velocity = moving_parts(given, camera, scene, velocity)
    at |= _exposure_of(given, camera, scene, lit_by, at)
    taker, digital_db = camera.at_gain(at["gain_db"])
    size = (scene.shape[-2], scene.shape[-1])
    path = None
    if given.trajectory is not None:
        path = TrajectorySpec.parse(given.trajectory).of(taker, size, at["exposure_s"], given.seed)
    return Shot(
        scene,
        taker,
        at,
        digital_db,
        lit_by,
        _captures(given.hdr, taker),
        flicker(given, scene),
        path,
        moving,
        velocity,
        flow(given, taker, size, at.get(EGO.name), velocity),
    )


def _exposure_of(
    given: SceneFile, camera: Camera, scene: Tensor, lit_by: str | Curve, at: dict[str, float]
) -> dict[str, float]:
    """Time and gain, where the camera sets them."""
    if at["exposure_s"] == AUTOMATIC and at["gain_db"] not in (0.0, AUTOMATIC):
        raise ValueError(
            f"gain_db = {at['gain_db']:g}: goes with a stated exposure; with an automatic one it is set, too"
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


def _developed(given: SceneFile, shot: Shot, frames: list[Tensor]) -> list[NDArray[Any]]:
    if given.bit_depth == "native":
        return [each.to(torch.int32).numpy().astype("uint16") for each in frames]
    if len(shot.captures) == 1:
        seen = develop_8bit(frames[0], shot.camera, shot.digital_db, shot.illuminant)
    else:
        white = in_range("hdr_white", given.hdr_white, 1e-6, 1e6)
        shown_e = max(1e-9, shot.white_e * white / 10 ** (shot.digital_db / 20))
        fused = fuse(frames, shot.camera, shot.captures)
        picture = developed(fused, shot.camera, white_e=shown_e, illuminant=shot.illuminant)
        seen = picture.mul(255.0).round().to(torch.uint8)
    return [in_channels(seen, max(seen.shape[1], shot.scene.shape[1])).numpy()]


def _illuminant(name: str) -> str | Curve:
    """The spectrum of a name, checked, or of a CSV file."""
    if name.lower().endswith(".csv"):
        return Curve.from_csv(name)
    illuminant(name)
    return name


def _captures(ratios: str | None, camera: Camera) -> tuple[Capture, ...]:
    """The camera's or one, unless ratios say what shorter ones there are: "16" or "16,256"."""
    if ratios is None:
        return camera.captures or staggered()
    try:
        return staggered(*(float(part) for part in ratios.split(",")))
    except ValueError as error:
        raise ValueError(f"hdr = {ratios!r}: must be RATIO[,RATIO], such as 16 or 16,256 ({error})") from None


def _rolling(line_time_us: float | None, camera: Camera) -> Camera:
    """The camera with another line time, 0 for a global shutter; as it is where none is given."""
    if line_time_us is None:
        return camera
    in_range("line_time_us", line_time_us, 0.0, 1e6)
    rolls = "rolling" if camera.shutter == "global" else camera.shutter
    return replace(camera, row_time_s=line_time_us / 1e6, shutter=rolls if line_time_us else "global")
