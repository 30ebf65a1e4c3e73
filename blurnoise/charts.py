"""Analytic test targets rendered from their geometry: slanted edge, Siemens star, stop sign, flat patch.

Domain: linear reflectance in [0, 1], float32 on the CPU, shape (1, C, H, W). A pixel holds the mean over its
square: in closed form for the edge, as the mean of ``supersample``² points for the star and the sign, where 8² are
off by 0.04 in the worst pixel and 0.002 RMS (100 px sign).

Convention: x points right and y down, pixel centres lie at integer + 0.5. ``angle_deg`` turns the target
counter-clockwise as displayed, about its centre: at 0° the edge is vertical and bright on the right, a bright spoke
of the star points right, and the sign is upright; at 90° the edge is bright at the top, and STOP reads upwards.

All raise ``TypeError`` or ``ValueError`` that names the argument, its value and range; sides are integers from 1 to
16384 px, reflectances lie within 0 <= dark <= bright <= 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise._core import checks
from blurnoise._core.checks import counted, limited

# US stop sign R1-1, 30 in size (FHWA, Standard Highway Signs). All lengths in inches.
_SIGN_IN = 30.0  # flat to flat
_BORDER_IN = 0.75
_LETTER_IN = 10.0  # letter height
# Letters: our own strokes, after FHWA Series C (stroke about 0.14 of the height, width about half of it).
_STROKE_IN = 1.4
_S_HALF_IN, _T_HALF_IN, _O_HALF_IN, _P_HALF_IN = 2.65, 2.4, 2.75, 2.65
_S_X_IN, _T_X_IN, _O_X_IN, _P_X_IN = -9.15, -3.25, 2.65, 9.15  # letter centres: legend 23.6 in wide

# Linear RGB reflectance, our choice: sheeting white, and a red of luminance 0.10 at CIE xy (0.60, 0.33).
SIGN_WHITE = (0.8, 0.8, 0.8)
SIGN_RED = (0.43, 0.013, 0.012)

_POINTS_PER_BLOCK = 1 << 15  # sample points in flight: they stay in the cache, and PyTorch wakes no threads
_MOST_KEPT_PX = 1 << 16  # of a sign whose shares are kept: 0.5 MB


def flat_patch(height_px: int, width_px: int, *, reflectance: float = 0.18) -> Tensor:
    """Uniform grey patch, (1, 1, H, W), linear reflectance.

    >>> flat_patch(1, 3)
    tensor([[[[0.1800, 0.1800, 0.1800]]]])
    """
    shape = (1, 1, counted("height_px", height_px, "height_px"), counted("width_px", width_px, "height_px"))
    return torch.full(shape, checks.in_range("reflectance", reflectance, 0.0, 1.0))


def slanted_edge(
    height_px: int, width_px: int, *, angle_deg: float = 5.0, dark: float = 0.1, bright: float = 0.8
) -> Tensor:
    """Straight edge through the picture's centre, (1, 1, H, W), linear reflectance (ISO 12233 target).

    Every pixel holds the exact area its unit square has on the bright side. With the distance d from the
    pixel's centre to the edge and the unit normal's larger and smaller component a and b it is 1/2 + d/a for
    0 <= d <= (a - b)/2, then 1 - ((a + b)/2 - d)²/(2ab) up to d = (a + b)/2, then 1; odd about 1/2 for negative d.

    >>> slanted_edge(1, 4, angle_deg=45.0)
    tensor([[[[0.1000, 0.1875, 0.7125, 0.8000]]]])
    """
    counted("height_px", height_px, "height_px")
    counted("width_px", width_px, "height_px")
    checks.in_range("bright", bright, 0.0, 1.0)
    checks.in_range("dark", dark, 0.0, bright)
    cos, sin = math.cos(_radians(angle_deg)), math.sin(_radians(angle_deg))
    y, x = (torch.arange(n, dtype=torch.float64) + (0.5 - n / 2) for n in (height_px, width_px))
    distance = x * cos - y[:, None] * sin
    # By symmetry the edge's normal lies between an axis and a diagonal; b = 0 would divide by 0 below.
    a, b = max(abs(cos), abs(sin)), max(min(abs(cos), abs(sin)), 1e-300)
    d = distance.abs()
    corner = ((a + b) / 2 - d).clamp(min=0) ** 2 / (2 * a * b)
    area = torch.where(d <= (a - b) / 2, d / a, 0.5 - corner) * distance.sign() + 0.5
    return (dark + (bright - dark) * area).float()[None, None]


def siemens_star(
    size_px: float,
    *,
    height_px: int | None = None,
    width_px: int | None = None,
    cycles: int = 36,
    angle_deg: float = 0.0,
    dark: float = 0.1,
    bright: float = 0.8,
    supersample: int = 8,
) -> Tensor:
    """Siemens star of diameter ``size_px`` in the picture's centre, (1, 1, H, W), linear reflectance.

    The reflectance is m + c cos(cycles (φ - angle)), m = (bright + dark)/2, c = (bright - dark)/2. Around the star,
    and in the hub where a period is shorter than two sample points (radius < cycles/(π supersample) px), it is m. At
    radius r the frequency is cycles/(2πr) cycles/px. height_px, width_px: of the picture, or None: the star's.

    >>> siemens_star(64, cycles=24).shape
    torch.Size([1, 1, 64, 64])
    """
    radius = limited("size_px", size_px) / 2
    height, width = (
        math.ceil(size_px) if value is None else counted(name, value, "height_px")
        for name, value in (("height_px", height_px), ("width_px", width_px))
    )
    hub = counted("cycles", cycles) / (math.pi * counted("supersample", supersample))
    checks.in_range("bright", bright, 0.0, 1.0)
    checks.in_range("dark", dark, 0.0, bright)
    # Counter-clockwise as displayed, while y points down: hence atan2(-y, x).
    turn = _radians(angle_deg)

    def wave(x: Tensor, y: Tensor) -> Tensor:
        r = torch.hypot(x, y)
        value = torch.cos(cycles * (torch.atan2(-y, x) - turn))
        return torch.where((r < radius) & (r >= hub), value, 0.0)[None]

    mean, contrast = (bright + dark) / 2, (bright - dark) / 2
    star = _area_mean(wave, (0, 0, width, height), (width / 2, height / 2), supersample)
    return (mean + contrast * star)[None]


def stop_sign(
    size_px: float,
    *,
    height_px: int | None = None,
    width_px: int | None = None,
    angle_deg: float = 0.0,
    centre_px: tuple[float, float] | None = None,
    background: float | Tensor = 0.18,
    supersample: int = 8,
) -> Tensor:
    """US stop sign R1-1 before a background, (1, 3, H, W), linear RGB reflectance.

    size_px: the octagon's width between opposite flats, all in the proportions of the 30 in sign.
    centre_px: the sign's centre (x, y), by default the picture's; the picture is twice the sign's size if
    ``height_px`` and ``width_px`` are None. background: a grey, or a picture (1, 3, H, W) of the size.
    Raises ``ValueError``, too, unless the sign lies wholly inside the picture.

    >>> stop_sign(20)[0, :, 20, 12]  # red, left of the legend
    tensor([0.4300, 0.0130, 0.0120])
    """
    if isinstance(background, Tensor):
        shape = tuple(checks.image_batch("background", background).shape)
        height_px = shape[2] if height_px is None else height_px
        width_px = shape[3] if width_px is None else width_px
        if shape != (1, 3, height_px, width_px):
            raise ValueError(f"background: shape must be (1, 3, {height_px}, {width_px}), got {shape}")
        low, high = (float(end) for end in background.aminmax())
        if low < 0 or high > 1:
            raise ValueError(f"background: must lie within [0, 1], spans [{low:g}, {high:g}]")
    else:
        checks.in_range("background", background, 0.0, 1.0)
    box = stop_sign_box(
        size_px, height_px=height_px, width_px=width_px, angle_deg=angle_deg, centre_px=centre_px
    )
    counted("supersample", supersample)
    height, width, centre = _sign_frame(size_px, height_px, width_px, centre_px)
    left, top, right, bottom = math.floor(box[0]), math.floor(box[1]), math.ceil(box[2]), math.ceil(box[3])
    # A sign is drawn again as a layer, and for pages; large ones would fill the memory.
    small = (right - left) * (bottom - top) <= _MOST_KEPT_PX
    drawn = _shares if small else _shares.__wrapped__
    shares = drawn(size_px, _radians(angle_deg), (left, top, right, bottom), centre, supersample)
    picture = torch.as_tensor(background, dtype=torch.float32).expand(1, 3, height, width).clone()
    behind = picture[0, :, top:bottom, left:right]
    sign = torch.einsum("khw,kc->chw", shares, torch.tensor([SIGN_WHITE, SIGN_RED]))
    # The sign over what is behind it, by the share of each pixel that it covers.
    behind += sign - shares.sum(0) * behind
    return picture


@lru_cache(maxsize=128)
def _shares(
    size_px: float,
    turn: float,
    window: tuple[int, int, int, int],
    centre: tuple[float, float],
    supersample: int,
) -> Tensor:
    """Shares (2, H, W) of each pixel of a window that are a sign's white, and its red; turn: radians."""
    cos, sin, scale = math.cos(turn), math.sin(turn), _SIGN_IN / size_px

    def coverage(x: Tensor, y: Tensor) -> Tensor:
        u, v = (x * cos - y * sin) * scale, (x * sin + y * cos) * scale
        octagon = torch.maximum(torch.maximum(u.abs(), v.abs()), (u.abs() + v.abs()) * math.sqrt(0.5))
        sign, face = octagon < _SIGN_IN / 2, octagon < _SIGN_IN / 2 - _BORDER_IN
        white = (sign & ~face) | _legend(u, v)
        return torch.stack([white, sign & ~white]).float()

    return _area_mean(coverage, window, centre, supersample)


def stop_sign_box(
    size_px: float,
    *,
    height_px: int | None = None,
    width_px: int | None = None,
    angle_deg: float = 0.0,
    centre_px: tuple[float, float] | None = None,
) -> tuple[float, float, float, float]:
    """Tight bounding box (x0, y0, x1, y1), px, of the octagon that :func:`stop_sign` draws for these arguments.

    >>> stop_sign_box(20)
    (10.0, 10.0, 30.0, 30.0)
    """
    height, width, (x, y) = _sign_frame(size_px, height_px, width_px, centre_px)
    eighth = math.pi / 4
    corner = math.remainder(_radians(angle_deg) + eighth / 2, eighth)  # angle from an axis to the next corner
    half = size_px / 2 * math.cos(corner) / math.cos(eighth / 2)  # a corner is so much farther than a flat
    box = (x - half, y - half, x + half, y + half)
    slack = 1e-9 * size_px  # a sign that exactly fills the picture may pass its border by a rounding error
    if box[0] < -slack or box[1] < -slack or box[2] > width + slack or box[3] > height + slack:
        shown = ", ".join(f"{edge:g}" for edge in box)
        raise ValueError(f"the sign's box ({shown}) px must lie inside the picture, {width} x {height} px")
    return max(box[0], 0.0), max(box[1], 0.0), min(box[2], float(width)), min(box[3], float(height))


def stop_sign_text_box(
    size_px: float,
    *,
    height_px: int | None = None,
    width_px: int | None = None,
    centre_px: tuple[float, float] | None = None,
) -> tuple[float, float, float, float]:
    """Tight box (x0, y0, x1, y1), px, of the word STOP that :func:`stop_sign` draws upright for these arguments.

    >>> stop_sign_text_box(30)
    (18.2, 25.0, 41.8, 35.0)
    """
    stop_sign_box(size_px, height_px=height_px, width_px=width_px, centre_px=centre_px)
    _, _, (x, y) = _sign_frame(size_px, height_px, width_px, centre_px)
    scale = size_px / _SIGN_IN
    left, right, half = _S_X_IN - _S_HALF_IN, _P_X_IN + _P_HALF_IN, _LETTER_IN / 2
    return x + left * scale, y - half * scale, x + right * scale, y + half * scale


def _sign_frame(
    size_px: float, height_px: int | None, width_px: int | None, centre_px: tuple[float, float] | None
) -> tuple[int, int, tuple[float, float]]:
    """Picture height, width and the sign's centre (x, y), with the defaults filled in."""
    side = 2 * math.ceil(limited("size_px", size_px))
    height = side if height_px is None else counted("height_px", height_px, "height_px")
    width = side if width_px is None else counted("width_px", width_px, "height_px")
    if centre_px is None:
        return height, width, (width / 2, height / 2)
    if not isinstance(centre_px, Sequence) or len(centre_px) != 2:
        raise ValueError(f"centre_px = {checks.shown(centre_px)}: must be two numbers (x, y)")
    x, y = (limited("centre_px", value) for value in centre_px)
    return height, width, (x, y)


def _legend(x: Tensor, y: Tensor) -> Tensor:
    """Whether the points (x, y), inches right and down from the sign's centre, lie on the word STOP."""
    half, half_stroke = _LETTER_IN / 2, _STROKE_IN / 2
    within = y.abs() < half
    if not within.any():
        return within

    # S: two arcs joined by the common tangent that crosses between them; unchanged by half a turn.
    radius = _S_HALF_IN - half_stroke  # of the arcs' centre line
    rise = half - half_stroke - radius  # from the letter's centre to an arc's
    normal_y = radius / rise  # the tangent's unit normal is (normal_x, -normal_y)
    normal_x = math.sqrt(1 - normal_y**2)
    u, v = torch.where(y > 0, -(x - _S_X_IN), x - _S_X_IN), -y.abs() + rise  # from the upper arc's centre
    along = u * normal_y + v * normal_x
    arc = ((torch.hypot(u, v) - radius).abs() < half_stroke) & ((v <= 0) | (along <= 0))
    spine = ((u * normal_x - (v - rise) * normal_y).abs() < half_stroke) & (along > 0)

    # T: a bar and a stem.
    u = (x - _T_X_IN).abs()
    letter_t = ((y < 2 * half_stroke - half) & (u < _T_HALF_IN)) | (u < half_stroke)

    # O: a ring about a vertical line, straight sides between two half circles.
    distance = torch.hypot(x - _O_X_IN, (y.abs() - (half - _O_HALF_IN)).clamp(min=0))
    ring = (distance - (_O_HALF_IN - half_stroke)).abs() < half_stroke

    # P: a stem and a bowl, two bars closed by a half circle; the bowl takes 0.58 of the height.
    u, outer = x - _P_X_IN, 0.58 * half
    distance = torch.hypot((u - (_P_HALF_IN - outer)).clamp(min=0), y + half - outer)
    bowl = (distance - (outer - half_stroke)).abs() < half_stroke
    letter_p = (bowl | (u < 2 * half_stroke - _P_HALF_IN)) & (u > -_P_HALF_IN)

    return (arc | spine | letter_t | ring | letter_p) & within


def _area_mean(
    shade: Callable[[Tensor, Tensor], Tensor],
    window: tuple[int, int, int, int],
    origin: tuple[float, float],
    supersample: int,
) -> Tensor:
    """Mean over each pixel of ``window`` of what ``shade`` maps points (x, y) from ``origin`` to, as (C, H, W)."""
    left, top, right, bottom = window

    def samples(first: int, last: int, zero: float) -> Tensor:
        steps = torch.arange((last - first) * supersample, dtype=torch.float64)
        return ((steps + 0.5) / supersample + (first - zero)).float()

    x = samples(left, right, origin[0])
    rows = max(1, _POINTS_PER_BLOCK // (len(x) * supersample))
    blocks = []
    for row in range(top, bottom, rows):
        y = samples(row, min(row + rows, bottom), origin[1])
        blocks.append(avg_pool2d(shade(x[None, :], y[:, None]), supersample))
    return torch.cat(blocks, dim=1)


def _radians(angle_deg: float) -> float:
    return math.radians(math.remainder(limited("angle_deg", angle_deg), 360.0))
