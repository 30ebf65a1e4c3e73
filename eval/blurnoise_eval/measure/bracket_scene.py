"""The scene behind a bracket: its light, merged from pictures by their tone curve, and that light taken again.

Domain: pictures of 8 bits, (H, W, 3); light is linear, (H, W, 3), 1 is what clips in the reference exposure. Light is
the mean of all pictures in which the pixel does not clip, weighted by the inverse of the variance that one value of
the file is worth (Debevec & Malik, SIGGRAPH 1997, with the weights of Robertson, Borman & Stevenson, ICIP 1999).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise._core import rng
from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone, untoned
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.picture.fusion import captures_of
from blurnoise.picture.steps import highest
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise.scene.take import TakeOptions, take
from blurnoise_eval.calibration.bracket import Bytes, Shot

Floats = NDArray[np.float32]
_UNCLIPPED = 0.94  # of the value that clips: JPEG spreads that of clipped areas so far (240 of 255)
_MIDDLE, _FEWEST = (24, 200), 0.01  # values, and share of a picture, whose light is compared with the scene's
_DARK = 8  # value below which rounding decides, so that darker ones count no more than it


@dataclass(frozen=True)
class MergedScene:
    """Light of a scene, (H, W, 3), 1 clips in ``reference``; and the share of pixels that clip in every picture."""

    light: Floats
    reference: Shot
    clipped: float


def merge(shots: Sequence[Shot], pictures: Sequence[Bytes], tone: PictureTone) -> MergedScene:
    """The scene of a bracket. Pixels that clip in all pictures keep the light at which the shortest one clips.

    >>> from pathlib import Path
    >>> light = np.repeat(np.linspace(0.01, 4.0, 60).reshape(6, 10, 1), 3, 2)
    >>> shots = [Shot(Path(f"{time}.png"), time) for time in (0.25, 1.0)]
    >>> pictures = [np.rint(255 * np.minimum(light * shot.exposure, 1)).astype(np.uint8) for shot in shots]
    >>> scene = merge(shots, pictures, "linear")
    >>> bool(np.abs(scene.light - light).max() < 0.02)  # the longer picture clips from 1 on
    True
    """
    table = untoned(torch.arange(256, dtype=torch.float64) / 255, tone).numpy()
    clip = 255 * (1.0 if isinstance(tone, str) else tone[-1][1])
    slope = np.gradient(table)
    slope[:_DARK] = slope[_DARK]
    slope = np.maximum(slope, 1e-7)
    reference = shots[len(shots) // 2]
    order = sorted(range(len(shots)), key=lambda place: shots[place].exposure)
    total, weights = np.zeros(pictures[0].shape, np.float32), np.zeros(pictures[0].shape, np.float32)
    for place in order:
        relative, picture = shots[place].exposure / reference.exposure, pictures[place]
        weight = ((relative / slope) ** 2).astype(np.float32)[picture]
        weight *= picture.max(-1, keepdims=True) <= _UNCLIPPED * clip
        total += weight * (table / relative).astype(np.float32)[picture]
        weights += weight
    shortest = (table * reference.exposure / shots[order[0]].exposure).astype(np.float32)[pictures[order[0]]]
    seen = weights > 0
    light = np.where(seen, total / np.maximum(weights, 1e-30), shortest)
    return MergedScene(light, reference, float(1 - seen.mean()))


def off_exposure(scene: MergedScene, shot: Shot, picture: Bytes, tone: PictureTone) -> float:
    """Light of a picture over that of the scene at its exposure, EV, the median of its middle values; 0 without any.

    >>> from pathlib import Path
    >>> scene = MergedScene(np.full((8, 8, 3), 0.25, np.float32), Shot(Path("a.png"), 1.0), 0.0)
    >>> round(off_exposure(scene, Shot(Path("b.png"), 1.0), np.full((8, 8, 3), 128, np.uint8), "linear"), 2)
    1.01
    """
    middle = (picture >= _MIDDLE[0]) & (picture <= _MIDDLE[1]) & (scene.light > 0)
    if middle.mean() < _FEWEST:
        return 0.0
    table = untoned(torch.arange(256, dtype=torch.float64) / 255, tone).numpy()
    expected = scene.light[middle] * (shot.exposure / scene.reference.exposure)
    return float(np.median(np.log2(table[picture[middle]] / expected)))


def shown(scene: MergedScene, shots: Sequence[Shot], camera: Camera, seed: int = 0) -> Iterator[Bytes]:
    """The scene as ``camera`` takes it at each exposure, ISO and f-number, (H, W, 3); 1 in the reference is white.

    ISO above that of the reference is gain, as far as the camera has it; a lower one is more light.
    """
    light = Scene(torch.from_numpy(np.ascontiguousarray(scene.light.transpose(2, 0, 1)))[None])
    sensor = camera.sensor
    white_e = highest(camera) * (sensor.full_scale_dn - sensor.black_level_dn) / sensor.system_gain_dn_per_e
    per_lux_s = electrons_per_lux_s(camera) * captures_of(camera)[0].sensitivity
    least = min(shot.iso for shot in (*shots, scene.reference))
    for place, shot in enumerate(shots):
        relative = shot.exposure / scene.reference.exposure
        gain = shot.iso / least
        exposure = Exposure(
            camera,
            shot.exposure_s,
            white_e * relative / gain / (per_lux_s * shot.exposure_s),
            velocity_px_s=shot.speed_px_s,
            gain_db=20 * math.log10(gain),
            seed=rng.derived(seed, f"shot {place}"),
        )
        yield take(light, exposure, TakeOptions(("8 bit",))).images()[0]
