"""What a scene file says of the light before the camera, and of what moves in it.

Light is linear, (1, C, H, W), 1 is white; times in s, motion in px/s, right and down.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from blurnoise._core.checks import limited
from blurnoise.camera import Camera
from blurnoise.motion.ego import USUAL_VEHICLE
from blurnoise.scene import cutting
from blurnoise.scene.cutting import Cut, Matte
from blurnoise.scene.hdr import Flicker
from blurnoise.scene.metering import anchored
from blurnoise.scene.scene import scene_reflectance
from blurnoise_eval.datasets import decode, decode_linear, segmentation
from blurnoise_eval.plan.files import SceneFile
from blurnoise_eval.plan.lamps import emitters_of, pwm_of


def light(image: Path, given: SceneFile) -> Tensor:
    """A picture's linear light (1, C, H, W), 1 is white, as the picture's tone, grey anchor and emitters have it."""
    linear = given.picture_tone == "linear"
    scene = torch.from_numpy(decode_linear(image)) if linear else _shares(image)
    scene = scene[None, None] if scene.ndim == 2 else scene.permute(2, 0, 1)[None].contiguous()
    scene = anchored(scene if linear else scene_reflectance(scene, given.picture_tone), given.grey_anchor)
    if given.emitters is None:
        return scene
    path, times = emitters_of(given.emitters)
    return scene * (1 + mask(Path(path), scene.shape) * (times - 1))


def _shares(path: Path) -> Tensor:
    """A picture's numbers, 1 is all bits set."""
    stored = decode(path)
    return torch.from_numpy(stored.astype("float32") / float(2 ** (8 * stored.itemsize) - 1))


def mask(path: Path, size: tuple[int, ...]) -> Tensor:
    """A picture of that size (..., H, W) as shares (H, W), white being 1."""
    shares = _shares(path)
    shares = shares if shares.ndim == 2 else shares.mean(-1)
    if shares.shape != size[-2:]:
        sizes = " and ".join(f"{width} x {height}" for height, width in (shares.shape, size[-2:]))
        raise ValueError(f"{path}: a mask must have the size of its picture; they are {sizes} px")
    return shares


def numbers(text: str) -> list[float]:
    """Of "1,2.5"; none of another text."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


def _matte(where: str, size: tuple[int, int]) -> Matte:
    """Of an object in a picture (H, W), "mask.png" or "x,y,width,height"."""
    box = numbers(where)
    if box and len(box) != 4:
        raise ValueError(f"object = {where!r}: must be MASK.png or X,Y,WIDTH,HEIGHT")
    found: Matte = (
        segmentation.of_box(box[0], box[1], box[2], box[3], size) if box else mask(Path(where), size).numpy()
    )
    if not found.any():
        raise ValueError(f"object = {where!r}: covers no pixel of the picture")
    return found


def moving_parts(
    given: SceneFile, scene: Tensor, velocity_px_s: tuple[float, float]
) -> tuple[Cut | None, tuple[float, float]]:
    """What moves for itself, with its velocity, and that of the rest. Raises ``ValueError`` for what stands alone."""
    own, still = (given.object_dx, given.object_dy), (0.0, 0.0)
    stated = {"object_dx": own[0], "object_dy": own[1], "plate": given.plate, "moves": given.moving != "all"}
    if given.object is None:
        if lone := [name for name, value in stated.items() if value]:
            raise ValueError(f"{', '.join(lone)}: needs --object, the part that moves")
        return None, velocity_px_s
    for name, px_s in zip(("object_dx", "object_dy"), own, strict=True):
        limited(name, px_s, "velocity_px_s")
    if given.moving != "all":
        if any(own):
            raise ValueError(
                "object_dx, object_dy: cannot be combined with moves, by which dx and dy move one part"
            )
        own, velocity_px_s = (velocity_px_s, still) if given.moving == "targets" else (still, velocity_px_s)
    behind = None
    if given.plate is not None:
        if given.grey_anchor or given.emitters:
            raise ValueError(
                "plate: cannot be combined with grey_anchor or emitters, which change the picture's light alone"
            )
        behind = light(Path(given.plate), given)
        if behind.shape != scene.shape:
            sizes = f"{tuple(behind.shape)}, {tuple(scene.shape)}"
            raise ValueError(f"{given.plate}: a plate must have the size of its picture; they are {sizes}")
    matte = _matte(given.object, (scene.shape[-2], scene.shape[-1]))
    return cutting.cut_out(scene, [matte], [own], behind), velocity_px_s


def flow(
    given: SceneFile,
    camera: Camera,
    size: tuple[int, int],
    ego_m_s: float | None,
    velocity: tuple[float, float],
) -> Tensor | None:
    """What a camera sees that drives, px/s."""
    if ego_m_s is None:
        if given.vehicle is not None:
            raise ValueError("vehicle: needs ego_kmh, its speed")
        return None
    if any(velocity):
        raise ValueError("ego_kmh: cannot be combined with dx and dy, which move the whole picture alike")
    return (given.vehicle or USUAL_VEHICLE).flow_px_s(camera, size, ego_m_s)


def flicker(given: SceneFile, scene: Tensor) -> Flicker | None:
    """A lamp "HZ,DUTY[,PHASE]", where the mask says; a phase that is not given is drawn from the seed."""
    if given.pwm is None:
        if given.pwm_mask is not None:
            raise ValueError("pwm_mask: needs pwm, the pulses of its lamp")
        return None
    lamp, has_phase = pwm_of(given.pwm)
    lamp = lamp if has_phase else lamp.with_phase_of(given.seed)
    return Flicker(lamp, None if given.pwm_mask is None else mask(Path(given.pwm_mask), scene.shape))
