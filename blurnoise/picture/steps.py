"""The picture's steps, one table in causal order: digital numbers to a picture, after the converter.

Domain: digital numbers until :data:`BLACK_LEVEL` makes them linear light (1: full scale), or :data:`FUSION` those of
several captures (1: white); one plane (B, 1, H, W) of a mosaic up to the demosaicing, three colours after it; then a
picture in [0, 1]. ``STEPS`` is read wherever a frame is developed: a new entry is all that a new step needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from blurnoise._core.checks import an_instance, limited, one_of
from blurnoise._core.threads import differentiable
from blurnoise.camera import Camera, colour
from blurnoise.camera.colour import Encoding, Matrix
from blurnoise.camera.isp import row_at
from blurnoise.camera.radiometry import clear_shares, filter_electrons
from blurnoise.camera.spectra import Curve, check_illuminant
from blurnoise.picture import enhancement
from blurnoise.picture.fusion import fuse

GAIN_MAX = 16.0
"""Of the automatic white balance: where the light lacks a colour by more, a tint stays."""
MARGIN = 2
"""Pixels of border that :func:`by_opencv` wants around a picture and takes off."""
_LEAST_WHITE_E = 1e-9  # of a picture without light, which stays black
_SUBSAMPLING = {
    "4:4:4": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    "4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "4:2:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
}
OFFSET, SCALE = 8192.0, 32768.0
"""Where integers of 16 bits hold linear light: 0 and the steps to 1, so that noise below black stays."""


@dataclass(frozen=True)
class Development:
    """Options of development: digital gain, the picture's encoding, the light on the scene.

    white_e: of several captures, the electrons of the first one that become white, (B,) or one number. Raises
    ``TypeError`` or ``ValueError`` naming the field.

    >>> Development(Camera.preset("imx250"), gain_db=6.0).encoding
    'srgb'
    """

    camera: Camera
    gain_db: float = 0.0
    encoding: Encoding = "srgb"
    illuminant: str | Curve = "D55"
    white_e: Tensor | float | None = field(default=None, compare=False)  # no table depends on it

    def __post_init__(self) -> None:
        an_instance("camera", self.camera, Camera)
        limited("gain_db", self.gain_db)
        one_of("encoding", self.encoding, ("srgb", "linear"))
        check_illuminant(self.illuminant)


def _of_mosaic(camera: Camera) -> bool:
    return camera.sensor.cfa not in colour.PLANES


@dataclass(frozen=True)
class PictureStep:
    """One entry of :data:`STEPS`.

    apply: the picture after the step; differentiable, on any device. active: whether the step changes this camera's
    frames. pointwise: each value depends on its own digital number alone, so tables serve. coded: it works on numbers
    of 8 bits, uint8 or floats over 255. amplifies: bound in DN for DN: the factor by which it enlarges a small
    difference at most, and by which less may be left out of frames.

    >>> half = PictureStep("half", lambda picture, at: picture / 2)
    >>> half.apply(torch.ones(1), Development(Camera.preset("imx250"))), half.active(Camera.preset("imx250"))
    (tensor([0.5000]), True)
    """

    name: str
    apply: Callable[[Tensor, Development], Tensor]
    active: Callable[[Camera], bool] = lambda camera: True
    pointwise: bool = True
    coded: bool = False
    amplifies: Callable[[Camera], float] = lambda camera: 1.0


def _fuses(camera: Camera) -> bool:
    return len(camera.sensor.captures) > 1


def _fused(picture: Tensor, at: Development) -> Tensor:
    """Light of several captures (captures, B, C, H, W): electrons of the first one, over those of white."""
    if at.white_e is None:
        raise ValueError("white_e: must be specified for a camera of several captures")
    # In electrons, not digital numbers: captures differ in gain, and in their black level.
    electrons = fuse(list(picture), at.camera)
    white_e = torch.as_tensor(at.white_e).to(electrons)
    return electrons / white_e.clamp_min(_LEAST_WHITE_E).view(-1, 1, 1, 1)


def _light(picture: Tensor, at: Development) -> Tensor:
    return (picture - at.camera.sensor.black_level_dn) / (
        at.camera.sensor.full_scale_dn - at.camera.sensor.black_level_dn
    )


def _balanced(picture: Tensor, at: Development) -> Tensor:
    """White balance: a gain per filter, the smallest 1, and one clipping level, so that highlights stay white."""
    # Every filter clips at the same level after its gain, else a full red pixel would tint a white highlight.
    height, width = picture.shape[-2:]
    # The pattern repeats every 2 x 2 pixels, from the picture's first one.
    tile = picture.new_tensor(site_gains(at.camera, at.illuminant)).view(2, 2)
    gains = tile.repeat((height + 1) // 2, (width + 1) // 2)[:height, :width]
    return (picture * gains).clamp(max=highest(at.camera))


def _corrected(picture: Tensor, at: Development) -> Tensor:
    """Colour matrix: camera colours to linear sRGB; RCCB first computes green by difference."""
    return torch.einsum("ij,bjhw->bihw", picture.new_tensor(matrix(at.camera, at.illuminant)), picture)


def _amplified(picture: Tensor, at: Development) -> Tensor:
    """Digital gain: multiplies signal and noise alike."""
    return picture if at.gain_db == 0 else picture * 10 ** (at.gain_db / 20)


def _toned(picture: Tensor, at: Development) -> Tensor:
    """Clip to [0, 1] and, unless the picture is linear, apply the camera's tone curve, by default sRGB."""
    return colour.toned(picture, at.camera.isp.tone) if at.encoding == "srgb" else picture.clamp(0.0, 1.0)


def _enhancing(
    name: str,
    figure: str,
    work: Callable[[enhancement.Image, Any], enhancement.Image],
    amplifies: Callable[[Any], float],
) -> PictureStep:
    """The step that a figure of the ISP switches on: a record, or a table of them by gain; ``work`` takes the row."""

    def rows(camera: Camera) -> tuple[Any, ...]:
        stated = getattr(camera.isp, figure)
        return stated if isinstance(stated, tuple) else (stated,) * (stated is not None)

    def apply(picture: Tensor, at: Development) -> Tensor:
        if at.encoding != "srgb" or picture.ndim < 3:
            return picture
        if differentiable(picture):
            must = "must be off in a camera whose pictures carry gradients"
            raise ValueError(f"{figure}: has no derivative; {must}")
        row = row_at(rows(at.camera), at.gain_db)
        return enhancement.by_image(picture, lambda image: work(image, row))

    def most(camera: Camera) -> float:
        return max(map(amplifies, rows(camera)), default=1.0)

    return PictureStep(
        name, apply, lambda camera: bool(rows(camera)), pointwise=False, coded=True, amplifies=most
    )


def _compressed(picture: Tensor, at: Development) -> Tensor:
    """A round trip through libjpeg of each picture; three planes are colours, others grey; gradients pass."""
    isp = at.camera.isp
    if at.encoding != "srgb" or picture.ndim < 3 or isp.jpeg_quality is None:
        return picture
    options = [cv2.IMWRITE_JPEG_QUALITY, isp.jpeg_quality]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, _SUBSAMPLING[isp.jpeg_subsampling]]
    compressed = enhancement.by_image(picture, lambda image: _round_trip(image, options))
    # A codec has no derivative: gradients pass as if it kept the picture.
    return picture + (compressed - picture).detach() if picture.requires_grad else compressed


def _round_trip(image: enhancement.Image, options: list[int]) -> enhancement.Image:
    """Encode and decode an image."""
    given = np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image
    _, file = cv2.imencode(".jpg", given, options)
    decoded: Any = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
    back: enhancement.Image = decoded[..., ::-1] if image.ndim == 3 else decoded
    return back


def _corrects(camera: Camera) -> bool:
    return camera.isp.ccm is not None or camera.sensor.cfa == "RCCB"


FUSION = PictureStep("fusion", _fused, _fuses, pointwise=False)
BLACK_LEVEL = PictureStep("black level", _light, lambda camera: not _fuses(camera))
WHITE_BALANCE = PictureStep("white balance", _balanced, _of_mosaic, pointwise=False)
DEMOSAIC = PictureStep(
    "demosaic",
    lambda picture, at: demosaic(picture, at.camera.sensor.cfa, at.camera.isp.demosaic),
    _of_mosaic,
    pointwise=False,
)
COLOUR_MATRIX = PictureStep("colour matrix", _corrected, _corrects, pointwise=False)
STEPS = (
    FUSION,
    BLACK_LEVEL,
    WHITE_BALANCE,
    DEMOSAIC,
    COLOUR_MATRIX,
    PictureStep("digital gain", _amplified),
    PictureStep("tone", _toned),
    _enhancing("noise reduction", "noise_reduction", enhancement.denoised, enhancement.steepest),
    _enhancing("local tone", "local_tone", enhancement.locally_toned, lambda row: 1 + row.clip_limit),
    _enhancing("sharpening", "sharpening", enhancement.sharpened, lambda row: 1 + row.strength),
    PictureStep(
        "JPEG",
        _compressed,
        lambda camera: camera.isp.jpeg_quality is not None,
        pointwise=False,
        coded=True,
    ),
)


def active(camera: Camera) -> tuple[PictureStep, ...]:
    """The steps that do something to this camera's frames, in order.

    >>> [step.name for step in active(Camera.preset("imx250c"))]
    ['black level', 'white balance', 'demosaic', 'colour matrix', 'digital gain', 'tone']
    """
    return tuple(step for step in STEPS if step.active(camera))


@lru_cache(maxsize=64)
def site_gains(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, ...]:
    """White-balance gains of the pattern's four places.

    >>> [round(gain, 2) for gain in site_gains(Camera.preset("imx250c"))]  # R G / G B: the strongest keeps 1
    [1.1, 1.0, 1.0, 1.82]
    """
    letters = dict.fromkeys(camera.sensor.cfa)
    if isinstance(camera.isp.white_balance, str):
        electrons = filter_electrons(camera, illuminant)
        most = max(electrons.values())
        gains = {each: min(most / max(electrons[each], 1e-30), GAIN_MAX) for each in letters}
    else:
        red, middle, blue = camera.isp.white_balance
        stated = {"R": red, "G": middle, "C": middle, "B": blue}
        # The smallest gain becomes 1: below it a clipped highlight would turn out darker than white.
        least = min(stated[each] for each in letters)
        gains = {each: stated[each] / least for each in letters}
    return tuple(gains[letter] for letter in camera.sensor.cfa)


def highest(camera: Camera) -> float:
    """The level of linear light from which on a pixel counts as saturated.

    >>> figures = {"black_level_dn": 95.0, "system_gain_dn_per_e": 0.25, "full_well_e": 8000.0}
    >>> highest(Camera.preset("imx250").with_figures(**figures)) < 0.5  # the well is full at half of the range
    True
    """
    if _fuses(camera):  # in place of a capture that is full, the next one counts: only white is a limit
        return 1.0
    return (camera.sensor.saturated_dn - camera.sensor.black_level_dn) / (
        camera.sensor.full_scale_dn - camera.sensor.black_level_dn
    )


@lru_cache(maxsize=64)
def matrix(camera: Camera, illuminant: str | Curve = "D55") -> Matrix:
    """Matrix from the demosaiced colours to linear sRGB; rows sum to 1.

    >>> matrix(Camera.preset("imx250"))[0]  # no colour matrix: the colours stay
    (1.0, 0.0, 0.0)
    """
    corrected = colour.normalised(camera.isp.ccm)
    if camera.sensor.cfa != "RCCB":
        return corrected
    red, green, blue = clear_shares(camera, illuminant)
    # Clear = red share x R + green share x G + blue share x B of balanced values, solved for G.
    by_difference = ((1.0, 0.0, 0.0), (-red / green, 1 / green, -blue / green), (0.0, 0.0, 1.0))
    return colour.as_rows(np.array(corrected) @ np.array(by_difference))


@lru_cache(maxsize=64)
def magnification(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Largest factor, RMS, by which development magnifies the plane's noise, the digital gain apart.

    >>> magnification(Camera.preset("imx250")), magnification(Camera.preset("imx250c")) > 1.5
    (1.0, True)
    """
    enhanced = math.prod(step.amplifies(camera) for step in STEPS)
    return enhanced * _of_colours(camera, illuminant)


def _of_colours(camera: Camera, illuminant: str | Curve) -> float:
    """Largest factor of white balance and colour matrix; 1 without a mosaic."""
    if camera.sensor.cfa in colour.PLANES:
        return 1.0
    gains = dict(zip(camera.sensor.cfa, site_gains(camera, illuminant), strict=True))
    if camera.sensor.cfa == "RCCC":
        return gains["C"]
    each = [gains["R"], gains.get("G", gains.get("C", 1.0)), gains["B"]]
    return max(1.0, float(np.sqrt(((np.array(matrix(camera, illuminant)) * each) ** 2).sum(1)).max()))


def demosaic(plane: Tensor, cfa: str, method: Literal["bilinear", "edge"]) -> Tensor:
    """Colours (B, 3, H, W) of planes (B, 1, H, W); of RCCB clear in green's place, of RCCC three times grey.

    The plane's values are balanced: white is the same behind every filter. "bilinear": the mean of the nearest pixels
    behind a filter. "edge": OpenCV's edge-aware one, of which only the values are known; its derivatives are those of
    "bilinear", as is all of RCCC. Pictures continue by reflection about their border pixels, which keeps the pattern.

    >>> red = torch.zeros(1, 1, 4, 4)
    >>> red[..., ::2, ::2] = 1.0  # the red pixels of RGGB
    >>> demosaic(red, "RGGB", "bilinear")[0, :, 1, 1].tolist()  # red comes from the four corners
    [1.0, 0.0, 0.0]
    """
    if method == "bilinear" or cfa == "RCCC":
        return _bilinear(plane, cfa)
    # OpenCV takes integers: black lies at OFFSET, so that noise below it is not cut before the tone curve.
    with torch.no_grad():
        codes = (plane * SCALE + OFFSET).round().clamp(0, 65535).cpu().numpy().astype(np.uint16)
        colours = np.stack([by_opencv(padded(picture[0]), cfa, method) for picture in codes])
        channels = torch.from_numpy(colours.astype(np.float32)).permute(0, 3, 1, 2)
        edge = (channels.to(plane) - OFFSET) / SCALE
    if not (plane.requires_grad and torch.is_grad_enabled()):
        return edge
    smooth = _bilinear(plane, cfa)
    return smooth + (edge - smooth).detach()


def padded(plane: NDArray[Any]) -> NDArray[Any]:
    """A plane (H, W) with ``MARGIN`` pixels around it.

    >>> padded(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]))[2].tolist()
    [3.0, 2.0, 1.0, 2.0, 3.0, 2.0, 1.0]
    """
    framed: NDArray[Any] = cv2.copyMakeBorder(plane, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_REFLECT_101)
    return framed


def by_opencv(raw: NDArray[np.uint16], cfa: str, method: str) -> NDArray[np.uint16]:
    """Colours (H, W, 3) of a plane with its margin, in integers of 16 bits; of RCCC grey, (H, W, 3) too.

    >>> grey = padded(np.full((4, 6), 20000, np.uint16))
    >>> by_opencv(grey, "RGGB", "edge")[0, 0].tolist()
    [20000, 20000, 20000]
    """
    inner = slice(MARGIN, -MARGIN)
    if cfa != "RCCC":
        # names of four letters count from the first row, those of two from the second
        name = f"COLOR_Bayer{cfa.replace('C', 'G')}2RGB"
        colours: NDArray[np.uint16] = cv2.cvtColor(
            raw, getattr(cv2, f"{name}_EA" if method == "edge" else name)
        )
        return colours[inner, inner]
    # Only red pixels lack their clear value: the mean of four neighbours, in integers, rounded.
    grey = raw.copy()
    up, down, left, right = raw[1:-2:2, 2:-1:2], raw[3::2, 2:-1:2], raw[2:-1:2, 1:-2:2], raw[2:-1:2, 3::2]
    total = up.astype(np.uint32) + down + left + right
    grey[2:-1:2, 2:-1:2] = (total + 2) // 4
    merged: NDArray[np.uint16] = cv2.merge([grey[inner, inner]] * 3)
    return merged


def _bilinear(plane: Tensor, cfa: str) -> Tensor:
    sites = plane.new_zeros((3, 1, 2, 2))
    for site, letter in enumerate(cfa):
        sites["RGB".index(letter.replace("C", "G")), 0, site // 2, site % 2] = 1.0
    height, width = plane.shape[-2:]
    here = sites.repeat(1, 1, (height + 1) // 2, (width + 1) // 2)[None, :, 0, :height, :width]
    if cfa == "RCCC":  # the four neighbours of a red pixel are clear
        red, framed = here[:, :1], nn.functional.pad(plane, (1, 1, 1, 1), mode="reflect")
        return torch.where(red > 0, _four_nearest(framed) / 4, plane).expand(-1, 3, -1, -1)
    red, green, blue = torch.chunk(nn.functional.pad(plane * here, (1, 1, 1, 1), mode="reflect"), 3, 1)
    return torch.cat(
        [_along_both(red), _four_nearest(green) / 4 + green[..., 1:-1, 1:-1], _along_both(blue)], 1
    )


# Sums of shifted planes, not a convolution: in double precision PyTorch's rounds by the size of the batch.


def _four_nearest(framed: Tensor) -> Tensor:
    """The sum of the pixels above, below, left and right of the inner ones of planes with a margin of one pixel."""
    across = framed[..., 1:-1, :-2] + framed[..., 1:-1, 2:]
    return across + (framed[..., :-2, 1:-1] + framed[..., 2:, 1:-1])


def _along_both(framed: Tensor) -> Tensor:
    """The mean of the nearest pixels of red or blue: itself, two neighbours in line, or four diagonal ones."""
    across = framed[..., 1:-1] + (framed[..., :-2] + framed[..., 2:]) / 2
    return across[..., 1:-1, :] + (across[..., :-2, :] + across[..., 2:, :]) / 2
