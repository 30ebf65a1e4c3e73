"""What ranges of exposure, light and motion do to a picture: one tile for each of a few draws.

Domain: sRGB-coded pictures, (H, W) grey or (H, W, 3) RGB, in [0, 1]. The tiles show every pixel of what is exposed,
so noise looks as large as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from blurnoise._core import rng
from blurnoise._core.checks import integer
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.training.augmentation import expose_pictures
from blurnoise.training.ranges import ExposureRanges
from blurnoise_eval.grid.axes import EXPOSURE
from blurnoise_eval.system.terminal import plain

MAX_TILES = 60
DPI = 100
_CAPTION_PX, _CAPTION_WIDTH_PX, _TITLE_PX, _GAP_PX = 40, 260, 30, 8


@dataclass(frozen=True)
class Tile:
    """A picture of 8 bits under one draw of conditions. direction_deg: counter-clockwise as displayed."""

    picture: NDArray[np.uint8]
    camera: Camera
    exposure_s: float
    illuminance_lux: float
    speed_px_s: float
    direction_deg: float

    @property
    def blur_px(self) -> float:
        """Length of the motion blur."""
        return self.speed_px_s * self.exposure_s

    @property
    def white_electrons(self) -> float:
        """Mean photo-electrons of a white pixel, whether they fit the pixel or not."""
        return photoelectrons(self.camera, self.illuminance_lux, self.exposure_s)

    def facts(self) -> dict[str, object]:
        """The conditions for JSON, the camera by name."""
        names = [entry.name for entry in fields(self)[2:]] + ["blur_px", "white_electrons"]
        return {"camera": self.camera.name, **{name: getattr(self, name) for name in names}}

    @property
    def caption(self) -> str:
        """Two lines: '12 ms · 50 lux · imx250' and '400 px/s · blur 4.8 px · white 2010 e-'."""
        light = f"{EXPOSURE.text(self.exposure_s)} · {self.illuminance_lux:.3g} lux"
        blur = f"{self.speed_px_s:.0f} px/s · blur {self.blur_px:.3g} px"
        return f"{light} · {plain(self.camera.name)}\n{blur} · white {self.white_electrons:.0f} e⁻"


def scene(picture: NDArray[np.uint8 | np.uint16], size_px: int) -> NDArray[np.float32]:
    """``picture`` in [0, 1], shrunk to ``size_px`` on its longer side where it is larger: what is exposed."""
    coded = picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
    scale = size_px / max(coded.shape[:2])
    if scale < 1:
        height, width = (max(1, round(side * scale)) for side in coded.shape[:2])
        coded = np.asarray(cv2.resize(coded, (width, height), interpolation=cv2.INTER_AREA), np.float32)
    return coded.clip(0.0, 1.0)


def tiles(
    coded: NDArray[np.float32],
    ranges: ExposureRanges,
    count: int,
    seed: int,
    progress: Callable[[int], object] = lambda done: None,
) -> list[Tile]:
    """``count`` draws from ``ranges``, 1 to ``MAX_TILES``, brightest first: by how far white fills the pixel.

    The same seed gives the same tiles. progress is called for each. Raises ``ValueError`` naming count or seed.
    """
    integer("count", count, 1, MAX_TILES)
    integer("seed", seed, 0, rng.LAST_SEED)
    generator = torch.Generator().manual_seed(seed)
    drawn = ranges.conditions(torch.rand(count, ranges.draws, generator=generator))
    seeds = rng.item_seeds(generator, count)
    drawn["noise_seed"] = torch.tensor(seeds)
    planes = torch.from_numpy(np.atleast_3d(coded)).permute(2, 0, 1)[None]
    names = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg")
    made = []
    for place, noise in enumerate(seeds):
        exposed = expose_pictures(planes, **ranges.arguments(drawn, [place]), generator=[noise])
        shown = exposed[0].mul(255).round().byte().permute(1, 2, 0).numpy().reshape(coded.shape)
        camera = ranges.cameras[int(drawn["camera_index"][place])]
        made.append(Tile(shown, camera, *(float(drawn[name][place]) for name in names)))
        progress(1)
    return sorted(made, key=lambda tile: -tile.white_electrons / tile.camera.saturation_e)


def draw(coded: NDArray[np.float32], made: Sequence[Tile]) -> Figure:
    """The picture as it is, then the tiles, a screen pixel for each of theirs at ``DPI``."""
    height, width = coded.shape[:2]
    original = np.asarray((coded * 255).round(), np.uint8)
    shown = [(original, "as it is\n"), *((tile.picture, tile.caption) for tile in made)]
    cell_x, cell_y = max(width, _CAPTION_WIDTH_PX) + _GAP_PX, height + _CAPTION_PX + _GAP_PX
    columns = max(1, round(math.sqrt(1.6 * len(shown) * cell_y / cell_x)))  # 1.6 times as wide as high
    full_x, full_y = columns * cell_x + _GAP_PX, math.ceil(len(shown) / columns) * cell_y + _TITLE_PX
    figure = Figure(figsize=(full_x / DPI, full_y / DPI), dpi=DPI)
    for index, (picture, caption) in enumerate(shown):
        row, column = divmod(index, columns)
        left, top = column * cell_x + _GAP_PX, row * cell_y + _TITLE_PX + _CAPTION_PX
        rgb = picture if picture.ndim == 3 else np.stack([picture] * 3, axis=-1)  # a colour map would round
        figure.figimage(rgb, left, full_y - top - height, origin="upper")
        where = (left / full_x, 1 - (top - 4) / full_y)
        figure.text(*where, caption, fontsize=8, va="bottom", linespacing=1.3, parse_math=False)
    title = f"One picture, {width} x {height} px, and what {len(made)} draws do to it, brightest first"
    figure.text(_GAP_PX / full_x, 1 - _GAP_PX / full_y, title, fontsize=10, va="top")
    return figure
