"""The fused route through the sensor's stages, on the CPU and without derivatives, a piece of a picture at a time.

Convention: NumPy planes (C, n), n pixels of C colours, float32 or float64. A piece stays in a core's cache
through all its steps. The physics stands in :mod:`blurnoise.sensor.stages`, whose reference gives the same frame to
a rounding step; :func:`supports` says which stages are in here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch import Tensor

from blurnoise._core.threads import side_by_side
from blurnoise.camera import Camera
from blurnoise.sensor import piece, stages
from blurnoise.sensor.piece import Light, Plane, Planes
from blurnoise.sensor.stage import Frames, Law, SensorStage

__all__ = ["MOST_APART", "Light", "Plane", "expose", "planes_of", "supports"]
_STAGES = (
    stages.SPECTRAL_INTEGRATION,
    stages.PRNU,
    stages.DARK_CURRENT,
    stages.SHOT_NOISE,
    stages.FULL_WELL,
    stages.READ_NOISE,
    stages.DSNU,
    stages.GAIN,
    stages.QUANTISATION,
    stages.LIMITS,
)
"""What is done here, in this order."""
_PIECE = 3 << 16  # values: few enough for the last cache, enough to outweigh the calls
MOST_APART = 256.0
"""The brightest of several lights over the faintest, at most: light is cut once, for all of them."""


def supports(active: Sequence[SensorStage]) -> bool:
    """Whether these stages, in this order, are what :func:`expose` does."""
    return list(active) == [stage for stage in _STAGES if stage in active or stage.essential]


def planes_of(scene: Tensor, at: Frames) -> Planes:
    """The planes of a frame (1, C, H, W); Poisson counts are drawn here, by the stages that lead to them."""
    counts = None
    if at.law == "exact":
        counts = scene
        for stage in (stages.SPECTRAL_INTEGRATION, stages.PRNU, stages.DARK_CURRENT, stages.SHOT_NOISE):
            counts = stage.apply(counts, at)
    fields = (at.normal, at.read, counts, at.gain, at.offset_e)
    flat = [None if field is None else field.reshape(scene.shape[1], -1).numpy() for field in fields]
    return Planes(scene.reshape(scene.shape[1], -1).numpy(), *flat)


def expose(
    planes: Planes,
    exposures: Sequence[Light],
    camera: Camera,
    law: Law,
    tones: Plane | None,
    threads: int,
) -> None:
    """Write the digital numbers of each exposure, or what ``tones`` has for them (one value for each number).

    law: how noise is drawn, see :data:`blurnoise.sensor.stage.Law`; all but "none" and "merged" take one
    exposure. ``threads`` share the pieces, which changes no bit.
    """
    colours, pixels = planes.light.shape
    count = threads * math.ceil(colours * pixels / _PIECE / threads)
    step = math.ceil(pixels / count)
    table = None if tones is None else piece.every_code(tones, camera.full_scale_dn)

    def expose_from(start: int) -> None:
        of = slice(start, start + step)
        light, *rest = planes
        parts = Planes(light[:, of], *(None if plane is None else plane[:, of] for plane in rest))
        piece.expose_piece(parts, of, exposures, camera, law, table)

    side_by_side(expose_from, range(0, pixels, step), threads)
