"""What ranges of exposure, light and motion do to a picture: one tile for each of a few draws.

Domain: 8- or 16-bit pictures, (H, W) grey or (H, W, 3) RGB. The tiles show every pixel of what is exposed, so
noise looks as large as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import integer
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.training.augmentation import expose_pictures
from blurnoise.training.ranges import ExposureRanges
from blurnoise_eval.grid.axes import EXPOSURE
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

MAX_TILES = 60
_DPI = 100
_CAPTION_PX, _CAPTION_WIDTH_PX, _TITLE_PX, _GAP_PX = 40, 260, 30, 8

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Tile:
    """A picture under one draw of conditions. direction_deg: counter-clockwise as displayed. motion: its kind."""

    picture: Picture
    camera: Camera
    exposure_s: float
    illuminance_lux: float
    speed_px_s: float
    direction_deg: float
    motion: str = ""

    @property
    def white_electrons(self) -> float:
        """Mean photo-electrons of a white pixel, whether they fit the pixel or not."""
        return photoelectrons(self.camera, self.illuminance_lux, self.exposure_s)

    @property
    def blur_px(self) -> float:
        """Length of the motion blur."""
        return self.speed_px_s * self.exposure_s

    def facts(self) -> dict[str, object]:
        """The conditions for JSON, the camera by name."""
        conditions = {entry.name: getattr(self, entry.name) for entry in fields(self)[2:-1]}
        conditions |= {"motion": self.motion} if self.motion else {}
        blur = {"blur_px": self.blur_px, "white_electrons": self.white_electrons}
        return {"camera": self.camera.name, **conditions, **blur}

    @property
    def caption(self) -> str:
        """Two lines: '12 ms · 50 lux · imx250' and '400 px/s · blur 4.8 px · white 2010 e-', or what moves."""
        lux, blur = f"{self.illuminance_lux:.3g} lux", f"blur {self.blur_px:.3g} px"
        if self.motion:
            return f"{EXPOSURE.text(self.exposure_s)} · {lux} · {plain(self.camera.name)}\n{self.motion}"
        return (
            f"{EXPOSURE.text(self.exposure_s)} · {lux} · {plain(self.camera.name)}\n"
            f"{self.speed_px_s:.0f} px/s · {blur} · white {self.white_electrons:.0f} e⁻"
        )


def scene(picture: NDArray[Any], size_px: int) -> NDArray[np.float32]:
    """``picture`` in [0, 1], shrunk to ``size_px`` on its longer side where it is larger: what is exposed."""
    return shrunk(picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max), size_px)


def shrunk(coded: NDArray[np.float32], size_px: int) -> NDArray[np.float32]:
    """Values (H, W) or (H, W, 3) with at most ``size_px`` on the longer side, within [0, 1]."""
    scale = size_px / max(coded.shape[:2])
    if scale < 1:
        height, width = (max(1, round(side * scale)) for side in coded.shape[:2])
        coded = cv2.resize(coded, (width, height), interpolation=cv2.INTER_AREA)
    return coded.clip(0.0, 1.0)


def tiles(
    coded: NDArray[np.float32],
    ranges: ExposureRanges,
    count: int,
    seed: int,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Tile]:
    """``count`` draws from ``ranges``, 1 to ``MAX_TILES``, brightest first: by how far white fills the pixel.

    coded: sRGB-coded, (H, W) or (H, W, 3). The same seed gives the same tiles. progress is told of each.
    Raises ``ValueError`` naming count or seed.
    """
    integer("count", count, 1, MAX_TILES)
    integer("seed", seed, 0, rng.LAST_SEED)
    generator = torch.Generator().manual_seed(seed)
    drawn = ranges.conditions(torch.rand(count, ranges.draws, generator=generator))
    cameras = [ranges.cameras[index] for index in drawn["camera_index"].tolist()]
    planes = planes_of(coded)
    seeds = rng.item_seeds(generator, count)
    drawn["noise_seed"] = torch.tensor(seeds)
    pictures = []
    for place, noise in enumerate(seeds):
        exposed = expose_pictures(planes, **ranges.arguments(drawn, [place]), generator=[noise])
        pictures.append(as_shown(exposed, coded.ndim))
        progress(1)
    columns = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg")
    rows = zip(*(drawn[name].tolist() for name in columns), strict=True)
    made = [Tile(*each, *row) for *each, row in zip(pictures, cameras, rows, strict=True)]
    return sorted(made, key=lambda tile: -tile.white_electrons / tile.camera.saturation_e)


def planes_of(coded: NDArray[np.float32]) -> Tensor:
    """A picture (H, W) or (H, W, C) as (1, C, H, W)."""
    return torch.from_numpy(coded if coded.ndim == 3 else coded[..., None]).permute(2, 0, 1)[None]


def as_shown(exposed: Tensor, ndim: int) -> NDArray[np.uint8]:
    """A picture (1, C, H, W) in [0, 1] as 8 bits, of so many dimensions."""
    shown: NDArray[np.uint8] = exposed[0].mul(255).round().byte().permute(1, 2, 0).numpy()
    return shown[..., 0] if ndim == 2 else shown


def draw(coded: NDArray[np.float32], made: list[Tile]) -> Figure:
    """The picture as it is, then the tiles, a screen pixel for each of theirs at 100 dpi."""
    height, width = coded.shape[:2]
    shown = [
        (np.asarray((coded * 255).round(), np.uint8), "as it is\n"),
        *((t.picture, t.caption) for t in made),
    ]
    cell_x, cell_y = max(width, _CAPTION_WIDTH_PX) + _GAP_PX, height + _CAPTION_PX + _GAP_PX
    columns = _columns(len(shown), cell_x / cell_y)
    full_x, full_y = columns * cell_x + _GAP_PX, math.ceil(len(shown) / columns) * cell_y + _TITLE_PX
    figure = Figure(figsize=(full_x / _DPI, full_y / _DPI), dpi=_DPI)
    for index, (picture, caption) in enumerate(shown):
        row, column = divmod(index, columns)
        left, top = column * cell_x + _GAP_PX, row * cell_y + _TITLE_PX + _CAPTION_PX
        rgb = picture if picture.ndim == 3 else np.stack([picture] * 3, axis=-1)  # a colour map would round
        figure.figimage(rgb, left, full_y - top - height, origin="upper")
        where = (left / full_x, 1 - (top - 4) / full_y)
        figure.text(*where, caption, fontsize=8, va="bottom", linespacing=1.3, parse_math=False)
    what = f"{len(made)} draws do to it, brightest first"
    if any(tile.motion for tile in made):
        what = f"{len(made)} kinds of motion do to it"
    title = f"One picture, {width} x {height} px, and what {what}"
    figure.text(_GAP_PX / full_x, 1 - _GAP_PX / full_y, title, fontsize=10, va="top")
    return figure


def write(figure: Figure, path: Path) -> None:
    """Write the figure, whole or not at all, in the format of the suffix. Raises ``OSError``."""
    write_figure(path, figure, dpi=_DPI)


def _columns(count: int, ratio: float) -> int:
    """Columns of a grid about 1.6 times as wide as high, few places empty, for tiles of this width to height."""
    near = round(math.sqrt(1.6 * count / ratio))
    return min(
        (columns for columns in (near, near + 1, near - 1) if columns > 0),
        key=lambda columns: -count % columns,
    )
