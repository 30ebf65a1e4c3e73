"""Edges that deceive and edges that do not, each from its closed form: what a check of slanted edges is judged by.

Domain: linear pictures (H, W), (3, H, W) where colours differ, black at 0 and full scale at 1; noise as a share of
full scale, lengths in px. A deceitful case says nothing of itself: full scale is never reached, no pixel is odd.
Only what made the picture tells it from an honest one, whose response is :func:`closed_mtf`'s.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import torch
from closed_edges import closed_edge, closed_mtf50
from torch import Tensor
from torch.nn.functional import conv2d, pad

from blurnoise.metrics import Flag, SlantedEdge, slanted_edge
from blurnoise.optics.colour import linear_from_srgb, srgb_from_linear


@dataclass(frozen=True)
class Setting:
    """One edge and its noise. noise: standard deviation; shot: variance at full scale that light adds."""

    dark: float = 0.2
    bright: float = 0.8
    noise: float = 0.005
    shot: float = 0.0
    sigma_px: float = 0.5
    motion_px: float = 0.0
    angle_deg: float = 5.0
    height_px: int = 100
    width_px: int = 120
    offset_px: tuple[float, float] = (0.0, 0.0)

    @property
    def blur(self) -> dict[str, Any]:
        """What :func:`closed_mtf50` needs to know."""
        motion_px = (self.motion_px, 0.0)
        return {"sigma_px": self.sigma_px, "motion_px": motion_px, "angle_deg": self.angle_deg}

    @property
    def mtf50(self) -> float:
        """The truth, cycles/px."""
        return closed_mtf50(**self.blur)

    def edge(self, **other: Any) -> Tensor:
        """The edge without noise, (H, W); ``other`` takes the place of a field for :func:`closed_edge`."""
        given = self.blur | {"offset_px": self.offset_px, "dark": self.dark, "bright": self.bright} | other
        return closed_edge(self.height_px, self.width_px, **given)

    def edge_by_rows(self, moves_px: Sequence[float]) -> Tensor:
        """The same with each row moved by as much to the right."""
        x, y = self.offset_px
        above = [row + 0.5 - self.height_px / 2 for row in range(self.height_px)]
        places = [(x + by, y - up) for by, up in zip(moves_px, above, strict=True)]
        return torch.cat([replaced(self, height_px=1, offset_px=place).edge() for place in places])

    def share(self, image: Tensor) -> Tensor:
        """0 on the dark side, 1 on the bright one."""
        return (image - self.dark) / (self.bright - self.dark)

    def level(self, share: Tensor) -> Tensor:
        """The inverse of :meth:`share`."""
        return self.dark + (self.bright - self.dark) * share

    def noisy(self, image: Tensor, draw: Draw) -> Tensor:
        """The picture with white noise, of which light adds a part."""
        return image + torch.sqrt(self.noise**2 + self.shot * image.clamp_min(0)) * draw.normal(image.shape)


@dataclass(frozen=True)
class Draw:
    """Random numbers of one picture."""

    generator: torch.Generator

    @classmethod
    def of(cls, *seeds: int) -> Draw:
        """Those of a picture by its seeds."""
        return cls(torch.Generator().manual_seed(int(np.random.SeedSequence(seeds).generate_state(1)[0])))

    def normal(self, shape: tuple[int, ...]) -> Tensor:
        """Of mean 0 and variance 1."""
        return torch.randn(shape, generator=self.generator, dtype=torch.float64)

    def uniform(self, low: float, high: float) -> float:
        """One number."""
        return low + (high - low) * float(torch.rand(1, generator=self.generator, dtype=torch.float64))


Make = Callable[[Setting, Draw], Tensor]


@dataclass(frozen=True)
class Case:
    """What is done to the edge. deceives: whether MTF50 is more than 3 % off at the usual setting.

    blur: of the picture, where it is not the setting's, by the fields of Setting.
    """

    name: str
    make: Make
    deceives: bool = True
    blur: Mapping[str, float] = field(default_factory=dict)

    def mtf50(self, at: Setting) -> float:
        """The truth in a setting, cycles/px."""
        return replaced(at, **self.blur).mtf50


def usual(draw: Draw, **other: Any) -> Setting:
    """0.2 to 0.8 at 5 degrees with 0.5 % noise, its place within a pixel drawn."""
    return Setting(offset_px=(draw.uniform(-1, 1), draw.uniform(-1, 1)), **other)


def _after(change: Callable[[Setting, Tensor], Tensor]) -> Make:
    """Change the picture first, then add the noise."""
    return lambda at, draw: at.noisy(change(at, at.edge()), draw)


def _before(change: Callable[[Setting, Tensor], Tensor]) -> Make:
    """Add the noise first: what changes the picture changes it, too."""
    return lambda at, draw: change(at, at.noisy(at.edge(), draw))


def _clipped(low: float, high: float) -> Callable[[Setting, Tensor], Tensor]:
    return lambda at, image: at.level(at.share(image).clamp(low, high))


def _rolled_off(at: Setting, image: Tensor) -> Tensor:
    """Linear up to 45 % of the step, then ever slower, as a film's shoulder."""
    share = at.share(image)
    return at.level(torch.where(share < 0.45, share, 0.45 + 0.25 * (1 - torch.exp(-(share - 0.45) / 0.25))))


def _s_shaped(at: Setting, image: Tensor) -> Tensor:
    share = at.share(image).clamp(-0.2, 1.2)
    return at.level(0.5 + 0.5 * torch.tanh(3 * (share - 0.5)) / math.tanh(1.5))


def _coded(_: Setting, image: Tensor) -> Tensor:
    return srgb_from_linear(image.clamp(0, 1))


def _sharpened(amount: float, sigma_px: float, cut: bool = False) -> Callable[[Setting, Tensor], Tensor]:
    def change(at: Setting, image: Tensor) -> Tensor:
        sharp = image + amount * (image - smoothed(image, sigma_px))
        return at.level(at.share(sharp).clamp(0, 1)) if cut else sharp

    return change


def smoothed(image: Tensor, sigma_px: float) -> Tensor:
    """A Gaussian of the pixels, the border replicated."""
    reach = math.ceil(4 * sigma_px)
    line = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=torch.float64) / sigma_px) ** 2)
    line = line / line.sum()
    wide = pad(image[None, None], (reach,) * 4, mode="replicate")
    return conv2d(conv2d(wide, line[None, None, None]), line[None, None, :, None])[0, 0]


def _two_steps(apart_px: float) -> Make:
    def make(at: Setting, draw: Draw) -> Tensor:
        x, y = at.offset_px
        left, right = (at.edge(offset_px=(x + side * apart_px / 2, y)) for side in (-1, 1))
        return at.noisy((left + right) / 2, draw)

    return make


def _colours_apart(at: Setting, draw: Draw) -> Tensor:
    x, y = at.offset_px
    return torch.stack([at.noisy(at.edge(offset_px=(x + by, y)), draw) for by in (1.0, 0.0, -1.0)])


def _jittered(draw_px: Callable[[Draw, int], Tensor]) -> Make:
    def make(at: Setting, draw: Draw) -> Tensor:
        moves = draw_px(draw, at.height_px).tolist()
        return at.noisy(at.edge_by_rows(moves), draw)

    return make


def _denoised(at: Setting, draw: Draw) -> Tensor:
    """Non-local means of the noisy picture at 16 bits."""
    whole = (at.noisy(at.edge(), draw).clamp(0, 1) * 65535).round().numpy().astype(np.uint16)
    strength = 65535 * math.sqrt(at.noise**2 + at.shot * at.bright) * 3.0
    found = cv2.fastNlMeansDenoising(
        whole, [strength], templateWindowSize=5, searchWindowSize=21, normType=cv2.NORM_L1
    )
    return torch.from_numpy(found.astype(np.float64)) / 65535


def _compressed(quality: int) -> Make:
    """sRGB-coded, as JPEG, and made linear again."""

    def make(at: Setting, draw: Draw) -> Tensor:
        coded = (255 * srgb_from_linear(at.noisy(at.edge(), draw).clamp(0, 1))).round()
        packed = cv2.imencode(".jpg", coded.numpy().astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        read = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.float64)
        return linear_from_srgb(torch.from_numpy(read) / 255)

    return make


def _plain(**other: Any) -> Make:
    """An honest edge whose blur, angle or noise is another."""

    def make(at: Setting, draw: Draw) -> Tensor:
        mine = replaced(at, **other)
        return mine.noisy(mine.edge(), draw)

    return make


def replaced(at: Setting, **other: Any) -> Setting:
    """``at`` with other fields; of a long motion, in a region as wide as it needs."""
    wide = max(at.width_px, 7 * math.ceil(other.get("motion_px", 0)))
    return Setting(**(vars(at) | {"width_px": wide} | other))


def _curved(at: Setting, draw: Draw) -> Tensor:
    """Rows moved along a parabola 1.5 px high."""
    heights = np.linspace(-1, 1, at.height_px) ** 2 * 1.5
    return at.noisy(at.edge_by_rows(heights.tolist()), draw)


def _hot(at: Setting, draw: Draw) -> Tensor:
    """One pixel in 2000 stands at 95 % of full scale."""
    image = at.noisy(at.edge(), draw)
    hot = torch.rand(image.shape, generator=draw.generator) < 1 / 2000
    return torch.where(hot, 0.95, image)


def _shaded(across: float, down: float) -> Make:
    def make(at: Setting, draw: Draw) -> Tensor:
        x, y = torch.linspace(-0.5, 0.5, at.width_px), torch.linspace(-0.5, 0.5, at.height_px)
        return at.noisy(at.edge() * (1 + across * x + down * y[:, None]), draw)

    return make


def _honest(name: str, **other: Any) -> Case:
    blur = {key: other[key] for key in ("sigma_px", "motion_px", "angle_deg") if key in other}
    return Case(f"plain, {name}", _plain(**other), deceives=False, blur=blur)


_NEVER = 9.0

CASES: tuple[Case, ...] = (
    *(Case(f"top clipped at {share:.0%}", _after(_clipped(-_NEVER, share))) for share in (0.95, 0.8, 0.5)),
    *(Case(f"both sides clipped by {share:.0%}", _after(_clipped(share, 1 - share))) for share in (0.1, 0.2)),
    Case("black clipped by 5%", _after(_clipped(0.05, _NEVER))),
    Case("top clipped at 80% with its noise", _before(_clipped(-_NEVER, 0.8))),
    Case("S-shaped tone curve, noise before", _before(_s_shaped)),
    Case("highlight roll-off", _after(_rolled_off)),
    Case("sRGB left in", lambda at, draw: _after(_coded)(replaced(at, dark=0.02), draw)),
    Case("unsharp mask 0.2", _after(_sharpened(0.2, 1.0))),
    Case("unsharp mask 1, sigma 1.5 px, halos cut", _after(_sharpened(1.0, 1.5, cut=True))),
    Case("half steps 3 px apart", _two_steps(3.0)),
    Case("half steps 6 px apart", _two_steps(6.0)),
    Case("lateral colour 1 px", _colours_apart),
    Case("row jitter 0.5 px", _jittered(lambda draw, rows: 0.5 * draw.normal((rows,)))),
    Case("non-local means", _denoised),
    Case("JPEG quality 50", _compressed(50)),
    *(_honest(f"sigma {sigma:g} px", sigma_px=sigma) for sigma in (0.3, 1.0, 3.0)),
    *(_honest(f"motion {px:g} px", sigma_px=0.3, motion_px=px) for px in (3.0, 10.0, 30.0)),
    *(_honest(f"angle {angle:g} degrees", angle_deg=angle) for angle in (2.0, 12.0, 26.565)),
    *(_honest(f"CNR {cnr:g}", noise=0.6 / cnr) for cnr in (60.0, 10.0)),
    _honest("no lens", sigma_px=0.0),
    Case("curved", _curved, deceives=False),
    Case("hot pixels", _hot, deceives=False),
    Case("JPEG quality 90", _compressed(90), deceives=False),
    Case("shading across 5%", _shaded(0.05, 0.0), deceives=False),
    Case("shading along 10%", _shaded(0.0, 0.1), deceives=False),
)  # fmt: skip


CAUGHT, SPARED = 0.95, 0.02
"""Least share of deceitful edges withheld or flagged, and largest share of honest ones."""
_TRUE_OF_HONEST = {
    Flag.NOISE_DOMINATED,
    Flag.NOISE_CORRELATED,
    Flag.EDGE_LEAVES_REGION,
    Flag.REGION_TOO_SMALL,
}
"""What says of an honest edge what is so: of its noise, or that the region drawn is too small for it."""


def measured(case: Case, seed: int, **options: Any) -> SlantedEdge:
    """A case's picture of a seed, measured; full scale is above every pixel: it says nothing of clipping."""
    draw = Draw.of(zlib.crc32(case.name.encode()), seed)
    found = slanted_edge(case.make(usual(draw), draw), full_scale=2.0, **options)
    assert isinstance(found, SlantedEdge)
    return found


def told(case: Case, seeds: Iterable[int]) -> float:
    """Share of a case's pictures that are withheld or flagged, of honest ones by what is not so."""
    true = set() if case.deceives else _TRUE_OF_HONEST
    return float(np.mean([bool(measured(case, seed, bootstrap=0).flags - true) for seed in seeds]))
