"""Edges that deceive and edges that do not, each from its closed form: what a check of slanted edges is judged by.

Domain: linear pictures (H, W), (3, H, W) where colours differ, black at 0 and full scale at 1; noise as a share of
full scale, lengths in px. A deceitful case says nothing of itself: full scale is never reached, no pixel is odd.
Only what made the picture tells it from an honest one, whose response is :func:`closed_mtf`'s.
"""

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import torch
from closed_edges import closed_edge, closed_mtf50
from torch.nn.functional import conv2d, pad

from blurnoise.camera.colour import linear_from_srgb, srgb_from_linear
from blurnoise.metrics import Flag, slanted_edge


@dataclass(frozen=True)
class Setting:
    """One edge and its noise. noise: standard deviation."""

    dark: float = 0.2
    bright: float = 0.8
    noise: float = 0.005
    sigma_px: float = 0.5
    motion_px: float = 0.0
    angle_deg: float = 5.0
    height_px: int = 100
    width_px: int = 120
    offset_px: tuple[float, float] = (0.0, 0.0)

    @property
    def _blur(self):
        motion_px = (self.motion_px, 0.0)
        return {"sigma_px": self.sigma_px, "motion_px": motion_px, "angle_deg": self.angle_deg}

    @property
    def mtf50(self):
        """The truth, cycles/px."""
        return closed_mtf50(**self._blur)

    def edge(self, moved_px=0.0):
        """The edge without noise, (H, W), moved to the right."""
        x, y = self.offset_px
        given = self._blur | {"offset_px": (x + moved_px, y), "dark": self.dark, "bright": self.bright}
        return closed_edge(self.height_px, self.width_px, **given)

    def edge_by_rows(self, moves_px):
        """The same with each row moved by as much to the right."""
        x, y = self.offset_px
        above = [row + 0.5 - self.height_px / 2 for row in range(self.height_px)]
        places = [(x + by, y - up) for by, up in zip(moves_px, above, strict=True)]
        return torch.cat([replace(self, height_px=1, offset_px=place).edge() for place in places])

    def share(self, image):
        """0 on the dark side, 1 on the bright one."""
        return (image - self.dark) / (self.bright - self.dark)

    def level(self, share):
        """The inverse of :meth:`share`."""
        return self.dark + (self.bright - self.dark) * share

    def noisy(self, image, draw):
        """The picture with white noise."""
        return image + self.noise * draw.normal(image.shape)


@dataclass(frozen=True)
class Draw:
    """Random numbers of one picture, by its seeds."""

    generator: torch.Generator

    @classmethod
    def of(cls, *seeds):
        return cls(torch.Generator().manual_seed(int(np.random.SeedSequence(seeds).generate_state(1)[0])))

    def normal(self, shape):
        return torch.randn(shape, generator=self.generator, dtype=torch.float64)

    def uniform(self, low, high):
        return low + (high - low) * float(torch.rand(1, generator=self.generator, dtype=torch.float64))


@dataclass(frozen=True)
class Case:
    """What is done to the edge of a Setting with a Draw. deceives: whether MTF50 is more than 3 % off at the usual
    setting. blur: of the picture, where it is not the setting's, by the fields of Setting."""

    name: str
    make: Callable
    deceives: bool = True
    blur: dict = field(default_factory=dict)

    def mtf50(self, at):
        """The truth in a setting, cycles/px."""
        return replace(at, **self.blur).mtf50


def usual(draw):
    """0.2 to 0.8 at 5 degrees with 0.5 % noise, its place within a pixel drawn."""
    return Setting(offset_px=(draw.uniform(-1, 1), draw.uniform(-1, 1)))


def _after(change):
    """Change the picture first, then add the noise."""
    return lambda at, draw: at.noisy(change(at, at.edge()), draw)


def _clipped(low, high):
    return _after(lambda at, image: at.level(at.share(image).clamp(low, high)))


def _rolled_off(at, image):
    """Linear up to 45 % of the step, then ever slower, as a film's shoulder."""
    share = at.share(image)
    return at.level(torch.where(share < 0.45, share, 0.45 + 0.25 * (1 - torch.exp(-(share - 0.45) / 0.25))))


def _sharpened(amount, sigma_px, cut=False):
    def change(at, image):
        sharp = image + amount * (image - smoothed(image, sigma_px))
        return at.level(at.share(sharp).clamp(0, 1)) if cut else sharp

    return _after(change)


def smoothed(image, sigma_px):
    """A Gaussian of the pixels, the border replicated."""
    reach = math.ceil(4 * sigma_px)
    line = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=torch.float64) / sigma_px) ** 2)
    line = line / line.sum()
    wide = pad(image[None, None], (reach,) * 4, mode="replicate")
    return conv2d(conv2d(wide, line[None, None, None]), line[None, None, :, None])[0, 0]


def _two_steps(apart_px):
    return lambda at, draw: at.noisy((at.edge(-apart_px / 2) + at.edge(apart_px / 2)) / 2, draw)


def _colours_apart(at, draw):
    return torch.stack([at.noisy(at.edge(by), draw) for by in (1.0, 0.0, -1.0)])


def _jittered(at, draw):
    return at.noisy(at.edge_by_rows(0.5 * draw.normal((at.height_px,)).numpy()), draw)


def _denoised(at, draw):
    """Non-local means of the noisy picture at 16 bits."""
    whole = (at.noisy(at.edge(), draw).clamp(0, 1) * 65535).round().numpy().astype(np.uint16)
    strength = 65535 * at.noise * 3.0
    found = cv2.fastNlMeansDenoising(
        whole, [strength], templateWindowSize=5, searchWindowSize=21, normType=cv2.NORM_L1
    )
    return torch.from_numpy(found.astype(np.float64)) / 65535


def _compressed(quality):
    """sRGB-coded, as JPEG, and made linear again."""

    def make(at, draw):
        coded = (255 * srgb_from_linear(at.noisy(at.edge(), draw).clamp(0, 1))).round()
        packed = cv2.imencode(".jpg", coded.numpy().astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        read = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.float64)
        return linear_from_srgb(torch.from_numpy(read) / 255)

    return make


def _curved(at, draw):
    """Rows moved along a parabola 1.5 px high."""
    return at.noisy(at.edge_by_rows(np.linspace(-1, 1, at.height_px) ** 2 * 1.5), draw)


def _hot(at, draw):
    """One pixel in 2000 stands at 95 % of full scale."""
    image = at.noisy(at.edge(), draw)
    hot = torch.rand(image.shape, generator=draw.generator) < 1 / 2000
    return torch.where(hot, 0.95, image)


def _shaded(at, draw):
    """By 5 % across and 10 % along."""
    x, y = torch.linspace(-0.5, 0.5, at.width_px), torch.linspace(-0.5, 0.5, at.height_px)
    return at.noisy(at.edge() * (1 + 0.05 * x + 0.1 * y[:, None]), draw)


def _honest(name, **other):
    """An edge whose blur, angle or noise is another; of a long motion, in a region as wide as it needs."""
    wide = {"width_px": max(120, 7 * math.ceil(other.get("motion_px", 0)))}

    def make(at, draw):
        mine = replace(at, **wide | other)
        return mine.noisy(mine.edge(), draw)

    return Case(f"plain, {name}", make, deceives=False, blur=wide | other)


_NEVER = 9.0

CASES = (
    Case("top clipped at 95%", _clipped(-_NEVER, 0.95)),
    Case("top clipped at 50%", _clipped(-_NEVER, 0.5)),
    Case("both sides clipped by 10%", _clipped(0.1, 0.9)),
    Case("black clipped by 5%", _clipped(0.05, _NEVER)),
    Case("highlight roll-off", _after(_rolled_off)),
    Case("unsharp mask 0.2", _sharpened(0.2, 1.0)),
    Case("unsharp mask 1, sigma 1.5 px, halos cut", _sharpened(1.0, 1.5, cut=True)),
    Case("half steps 3 px apart", _two_steps(3.0)),
    Case("half steps 6 px apart", _two_steps(6.0)),
    Case("lateral colour 1 px", _colours_apart),
    Case("row jitter 0.5 px", _jittered),
    Case("non-local means", _denoised),
    Case("JPEG quality 50", _compressed(50)),
    *(_honest(f"sigma {sigma:g} px", sigma_px=sigma) for sigma in (0.0, 0.3, 3.0)),
    *(_honest(f"motion {px:g} px", sigma_px=0.3, motion_px=px) for px in (3.0, 30.0)),
    *(_honest(f"angle {angle:g} degrees", angle_deg=angle) for angle in (2.0, 26.565)),
    *(_honest(f"CNR {cnr:g}", noise=0.6 / cnr) for cnr in (60.0, 10.0)),
    Case("curved", _curved, deceives=False),
    Case("hot pixels", _hot, deceives=False),
    Case("JPEG quality 90", _compressed(90), deceives=False),
    Case("shading", _shaded, deceives=False),
)  # fmt: skip


CAUGHT, SPARED = 0.95, 0.02
"""Least share of deceitful edges withheld or flagged, and largest share of honest ones."""
_TRUE_OF_HONEST = {
    *(Flag.NOISE_DOMINATED, Flag.NOISE_CORRELATED, Flag.EDGE_LEAVES_REGION, Flag.REGION_TOO_SMALL)
}
"""What says of an honest edge what is so: of its noise, or that the region drawn is too small for it."""


def measured(case, seed, **options):
    """A case's picture of a seed, measured; full scale is above every pixel: it says nothing of clipping."""
    draw = Draw.of(zlib.crc32(case.name.encode()), seed)
    return slanted_edge(case.make(usual(draw), draw), full_scale=2.0, **options)


def told(case, seeds):
    """Share of a case's pictures that are withheld or flagged, of honest ones by what is not so."""
    true = set() if case.deceives else _TRUE_OF_HONEST
    return float(np.mean([bool(measured(case, seed, bootstrap=0).flags - true) for seed in seeds]))
