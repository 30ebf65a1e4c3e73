"""An exposure in the units of a scene's pictures: the conditions of every capture, and the seeds of its noise.

Convention: times count from the start of the first capture. Each capture has its own window of time, so that it shows
a moving scene with a blur of its own length, displaced by the motion between the middles of the windows: ghosts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import limited_per_image
from blurnoise.blur.layer import Layer
from blurnoise.camera.captures import windows
from blurnoise.light.lamp import per_picture as lamp_per_picture
from blurnoise.light.resolved import BeamLight, Resolved, Shift, velocities
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.picture.fusion import captures_of, readers
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene


def captures_of_exposure(
    scene: Scene, exposure: Exposure[Any], batch: int
) -> Iterator[tuple[Resolved[Tensor], list[int]]]:
    """The conditions of every capture of a batch, and the seeds of its noise.

    The batch is that of the scene's pictures, or of exposures of its only one.

    >>> from blurnoise import Camera, Capture
    >>> camera = Camera.preset("imx250").with_figures(captures=(Capture(), Capture(exposure_ratio=16)))
    >>> exposure = Exposure(camera, exposure_s=0.016, illuminance_lux=50.0)
    >>> scene = Scene(torch.full((1, 1, 4, 6), 0.5))
    >>> [round(1e3 * float(at.exposure_s), 3) for at, _ in captures_of_exposure(scene, exposure, 1)]  # ms
    [16.0, 1.0]
    """
    camera, _ = exposure.amplified
    light = scene.light.expand(batch, -1, -1, -1)
    like = torch.empty(0, dtype=torch.float64)  # times are compared and added up
    exposure_s = limited_per_image("exposure_s", exposure.exposure_s, batch, like)
    lux = limited_per_image("illuminance_lux", exposure.illuminance_lux, batch, like)
    temperature_c = limited_per_image("temperature_c", exposure.temperature_c, batch, light)
    velocity = velocities(_background_velocity(scene, exposure), light)
    paths, lamps = per_picture(exposure.trajectory, batch), lamp_per_picture(exposure.lamp, batch)
    seeds = list(exposure.seed) if exposure.batched else [exposure.seed]
    if len(seeds) != batch:
        raise ValueError(f"seed: got {len(seeds)} for a batch of {batch}; must be one for each picture")
    of_scene: dict[str, Any] = {"objects": _layers(scene, exposure, batch), "lamps": lamps}
    if exposure.headlamp != "off":
        exposure.check_beside_headlamps(float(lux.detach().min()))
        of_scene["headlamp"] = _on_batch(scene.beam_light(exposure.headlamp), batch)
    if lamps and scene.lamp_mask is not None:
        of_scene["lamp_mask"] = scene.lamp_mask.expand(batch, -1, -1)
    captures = captures_of(camera)
    windows_s: list[list[tuple[float, float]]] = []  # of every picture, its captures
    if camera.sensor.captures or lamps:  # else nothing depends on when a picture is taken
        windows_s = [windows(captures, duration_s) for duration_s in exposure_s.tolist()]
    for number, (capture, reader) in enumerate(zip(captures, readers(camera), strict=True)):
        if windows_s:
            of_scene["windows_s"] = tuple(of_picture[number] for of_picture in windows_s)
        paths_now, seeds_now = paths, seeds
        if number:
            # From the middle of the first capture's exposure to the middle of this one's.
            later_s = [
                of_picture[number][0] + of_picture[number][1] / 2 - of_picture[0][1] / 2
                for of_picture in windows_s
            ]
            of_scene["shift"] = _shift(velocity, paths, windows_s, number, later_s)
            paths_now = tuple(path and path.later(by_s) for path, by_s in zip(paths, later_s, strict=False))
            # Two gains on one exposure read the same electrons: their noise is drawn from the same stream.
            streams = [of_picture.index(of_picture[number]) for of_picture in windows_s]
            streams = [one if captures[one].sensitivity == capture.sensitivity else number for one in streams]
            seeds_now = [
                rng.derived(seed, f"capture {stream}") if stream else seed
                for seed, stream in zip(seeds, streams, strict=True)
            ]
        ratio = captures[0].exposure_ratio, capture.exposure_ratio
        yield (
            Resolved.of(
                light,
                reader,
                exposure_s * ratio[0] / ratio[1],
                lux,
                temperature_c,
                velocity,
                paths_now,
                exposure.illuminant,
                capture.sensitivity,
                **of_scene,
            ),
            seeds_now,
        )


def _background_velocity(scene: Scene, exposure: Exposure[Any]) -> Any:
    """Velocity of the pictures, px/s, or of each of their pixels where the camera's vehicle drives."""
    if exposure.drives:
        return exposure.vehicle.flow_px_s(exposure.camera, scene.size, exposure.ego_speed_m_s)
    return (0.0, 0.0) if exposure.moves == "targets" else exposure.velocity_px_s


def _on_batch(lit: BeamLight, batch: int) -> BeamLight:
    """The light of a beam on every frame of a batch."""
    ranges = lit.ranges_lux * (batch // len(lit.ranges_lux))
    return lit._replace(ranges_lux=ranges, lux=lit.lux.expand(batch, -1, -1, -1))


def _layers(scene: Scene, exposure: Exposure[Any], batch: int) -> tuple[tuple[Layer, ...], ...]:
    """The layers of every frame; those of targets with the velocity that the exposure gives them."""
    every = scene.per_picture * (batch if len(scene.light) == 1 else 1)
    if not any(layer.speed is not None for layers in every for layer in layers):
        if exposure.moves != "all":
            raise ValueError(f"moves = {exposure.moves!r}: must be 'all' of a scene without cut-out targets")
        return every
    return tuple(
        tuple(replace(layer, velocity_px_s=one.velocity_of(layer), speed=None) for layer in layers)
        for one, layers in zip(exposure.each(batch), every, strict=True)
    )


def _shift(
    velocity: Tensor,
    paths: Sequence[Trajectory | None],
    windows_s: Sequence[Sequence[tuple[float, float]]],
    number: int,
    later_s: Sequence[float],
) -> Shift:
    """How far everything has moved from the middle of the first capture to the middle of capture ``number``."""
    later = velocity.new_tensor(later_s)
    along_path = velocity.new_zeros(len(velocity), 2)
    for item, path in enumerate(paths):
        if path is not None:
            (_, first_s), (_, duration_s) = windows_s[item][0], windows_s[item][number]
            x, y = path.later(later_s[item]).origin_px(duration_s)
            was_x, was_y = path.origin_px(first_s)
            along_path[item] = along_path.new_tensor([x - was_x, y - was_y])
    sizes = [1] * (velocity.ndim - 2)
    return Shift(later, along_path, velocity * later.view(-1, 1, *sizes) + along_path.view(-1, 2, *sizes))
