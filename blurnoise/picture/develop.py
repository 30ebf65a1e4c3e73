"""Development: digital numbers to a picture for viewing and for detectors, through all picture steps.

Beside the formulas, two faster ways on the CPU: a table of what they make of every digital number; and of mosaics
integers of 16 bits, with black at ``demosaic.OFFSET`` and ``demosaic.SCALE`` steps to full scale. Those are fine
beside the steps of a converter of up to 12 bits, and keep noise below black until the tone curve; means of neighbours
and matrices whose rows sum to 1 leave the offset. Both give the formulas' picture, to a few of these steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, finite, one_of
from blurnoise._core.limits import limited
from blurnoise._core.lookup import look_up, look_up_codes
from blurnoise._core.threads import side_by_side
from blurnoise._core.uncompiled import uncompiled
from blurnoise.optics import colour
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import LUMINANCE, Encoding
from blurnoise.optics.spectra import Curve, check_illuminant
from blurnoise.picture import steps
from blurnoise.picture.demosaic import OFFSET, SCALE, by_opencv, padded
from blurnoise.picture.step import Development, PictureStep

_INTEGERS = (
    *(torch.int8, torch.int16, torch.int32, torch.int64),
    *(torch.uint8, torch.uint16, torch.uint32, torch.uint64),
)


@uncompiled
def develop(
    dn: Tensor,
    camera: Camera,
    *,
    encoding: Encoding = "srgb",
    gain_db: float = 0.0,
    illuminant: str | Curve = "D55",
    whole: bool | None = None,
) -> Tensor:
    """Digital numbers to a picture in [0, 1]; no automatic gain.

    (dn - black) / (full scale - black) times 10^(gain_db / 20), clamped, then coded by the camera's tone curve (sRGB
    by default) unless ``encoding`` is "linear"; of a mosaic white balance for the light ``illuminant``, demosaic and
    colour matrix come before the gain: ``STEPS`` in their order. dn: any shape, of a mosaic (B, 1, H, W), which
    becomes (B, 3, H, W); values within the converter's range, beyond which they count as its ends; integers of any
    size, float32 or float64. Returns dn's floating dtype, for integers float32. whole: whether dn is known to hold
    whole numbers; None: that is looked at.
    By a table of the formulas, where each value depends on its own number; coded float32 mosaics on the CPU in
    integers of 16 bits; by the formulas where gradients are asked for, and of
    frames that were not rounded.
    Raises ``TypeError`` or ``ValueError`` naming dn (NaN and Inf are none), camera, encoding, gain_db or illuminant.
    """
    dn, kind = _digital_numbers(dn)
    at = _development(camera, encoding, gain_db, illuminant)
    active = _active(dn, camera)
    if (dn.requires_grad and torch.is_grad_enabled()) or not (_whole(dn) if whole is None else whole):
        return _developed(dn.to(kind), at, active)
    if fast := _fast(dn, at, active):
        found = _by_16_bits(dn, at, active[:fast], kind)
        return _developed(found, at, active[fast:])
    tabulated = _leading(active)
    found = look_up(_tones(at, active[:tabulated]).to(dn.device, kind), dn)
    return _developed(found, at, active[tabulated:])


def _whole(dn: Tensor) -> bool:
    return not dn.is_floating_point() or torch.equal(dn, dn.trunc())


def develop_8bit(dn: Tensor, camera: Camera, gain_db: float = 0.0, illuminant: str | Curve = "D55") -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, of its shape."""
    active = steps.active(camera)
    if _leading(active) == len(active):
        table = tones_8bit(camera, gain_db, illuminant).to(dn.device)
        return look_up(table, _digital_numbers(dn)[0])
    at = _development(camera, "srgb", gain_db, illuminant)
    if _fast(dn, at, active) == len(active):
        return _by_16_bits(_digital_numbers(dn)[0], at, _active(dn, camera), torch.uint8)
    picture = develop(dn, camera, gain_db=gain_db, illuminant=illuminant)
    return picture.mul(255.0).round().to(torch.uint8)


def tones_8bit(camera: Camera, gain_db: float = 0.0, illuminant: str | Curve = "D55") -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU, by the steps that look at one number only."""
    pointwise = tuple(step for step in steps.active(camera) if step.pointwise)
    return _tones_8bit(_development(camera, "srgb", gain_db, illuminant), pointwise)


def tabulated(camera: Camera) -> bool:
    """Whether :func:`tones_8bit` is all of :func:`develop_8bit`."""
    active = steps.active(camera)
    return _leading(active) == len(active)


def in_channels(picture: Tensor, channels: int) -> Tensor:
    """A picture (B, 1 or 3, H, W) in so many channels, those of the one exposed: grey repeated, colours to luma."""
    found = picture.shape[1]
    if found == channels:
        return picture
    if found == 1:
        return picture.expand(-1, channels, -1, -1)
    luma = torch.einsum("c,bchw->bhw", torch.tensor(LUMINANCE, device=picture.device), picture.float())[
        :, None
    ]
    return luma.round().to(picture.dtype) if picture.dtype == torch.uint8 else luma.to(picture.dtype)


def _leading(every: tuple[PictureStep, ...]) -> int:
    """How many steps, from the first on, are pointwise."""
    return next((place for place, step in enumerate(every) if not step.pointwise), len(every))


def _fast(dn: Tensor, at: Development, active: tuple[PictureStep, ...]) -> int:
    if at.encoding != "srgb" or dn.device.type != "cpu" or dn.dtype == torch.float64:
        return 0
    return steps_in_16_bits(active)


def _active(dn: Tensor, camera: Camera) -> tuple[PictureStep, ...]:
    """The steps; of a mosaic ``dn`` has one plane of at least 2 x 2."""
    if camera.cfa not in colour.PLANES and (dn.ndim != 4 or dn.shape[1] != 1 or min(dn.shape[-2:]) < 2):
        raise ValueError(
            f"dn: shape is {tuple(dn.shape)}; cfa = {camera.cfa!r} needs (B, 1, H, W), H and W at least 2"
        )
    return steps.active(camera)


def _digital_numbers(dn: Tensor) -> tuple[Tensor, torch.dtype]:
    """``dn``, and the type of a picture made of it."""
    an_instance("dn", dn, Tensor)
    if dn.dtype in _INTEGERS:
        return dn, torch.float32
    if dn.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"dn: must be integers, float32 or float64, got {dn.dtype}")
    return finite("dn", dn), dn.dtype


def _development(camera: Camera, encoding: Encoding, gain_db: float, illuminant: str | Curve) -> Development:
    an_instance("camera", camera, Camera)
    one_of("encoding", encoding, ("srgb", "linear"))
    check_illuminant(illuminant)
    return Development(camera, limited("gain_db", gain_db), encoding, illuminant)


def _by_16_bits(dn: Tensor, at: Development, every: tuple[PictureStep, ...], kind: torch.dtype) -> Tensor:
    coloured = steps.COLOUR_MATRIX in every
    return _in_16_bits(dn, at, coloured, _tones_of_16_bits(at, every[3 + coloured :], kind))


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _tones_of_16_bits(at: Development, every: tuple[PictureStep, ...], kind: torch.dtype) -> Tensor:
    table = _linear_tones(at, every)
    return table.mul(255.0).round().to(kind) if kind == torch.uint8 else table.to(kind)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _tones_8bit(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    return _tones(at, every).mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
@torch.inference_mode(False)
def _tones(at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    return _developed(torch.arange(at.camera.full_scale_dn + 1, dtype=torch.float64), at, every)


def _developed(dn: Tensor, at: Development, every: tuple[PictureStep, ...]) -> Tensor:
    for step in every:
        dn = step.apply(dn, at)
    return dn


def steps_in_16_bits(active: Sequence[PictureStep]) -> int:
    """How many of these steps, from the first on, are done here: a mosaic's and the pointwise ones after them."""
    mosaic = [step for step in (steps.BLACK_LEVEL, steps.WHITE_BALANCE, steps.DEMOSAIC) if step in active]
    count = len(mosaic)
    if count < 3 or list(active[:count]) != mosaic:
        return 0
    count += active[count : count + 1] == (steps.COLOUR_MATRIX,)
    while count < len(active) and active[count].pointwise:
        count += 1
    return count


def _linear_tones(at: Development, pointwise: Sequence[PictureStep]) -> Tensor:
    """What steps make of each linear value that 16 bits hold, float64."""
    values = (torch.arange(1 << 16, dtype=torch.float64) - OFFSET) / SCALE
    for step in pointwise:
        values = step.apply(values, at)
    return values


def _in_16_bits(dn: Tensor, at: Development, coloured: bool, table: Tensor) -> Tensor:
    """``table``'s values for the colours of planes (B, 1, H, W): (B, 3, H, W), channels last.

    coloured: whether the colour matrix takes part. table: a value for each linear one, see :func:`_linear_tones`.
    """
    batch, _, height, width = dn.shape
    camera = at.camera
    gains = np.array(steps.site_gains(camera, at.illuminant)).reshape(2, 2)
    gains = gains / (camera.full_scale_dn - camera.black_level_dn)
    columns = (width + 5) // 2  # with its margin
    by_rows = np.tile(gains, (1, columns))[None].astype(np.float32)
    rows = np.array(steps.matrix(camera, at.illuminant), np.float32) if coloured else None
    looked_up, highest = table.numpy(), np.float32(steps.highest(camera))
    frames = dn.detach().reshape(batch, height, width).numpy()
    out = torch.empty((batch, height, width, 3), dtype=table.dtype)

    def frame(place: int) -> None:
        numbers = np.subtract(frames[place], camera.black_level_dn, dtype=np.float32)
        np.clip(numbers, -camera.black_level_dn, camera.full_scale_dn - camera.black_level_dn, out=numbers)
        light = padded(numbers)
        if height % 2:
            light = np.concatenate([light, light[-1:]])
        pairs = light.reshape(len(light) // 2, 2, -1)
        np.multiply(pairs, by_rows[..., : light.shape[1]], out=pairs)
        np.minimum(light, highest, out=light)
        codes = cv2.addWeighted(
            light[: height + 4], SCALE, light[: height + 4], 0.0, OFFSET, dtype=cv2.CV_16U
        )
        colours = by_opencv(codes, camera.cfa, camera.demosaic)
        if rows is not None:
            colours = cv2.transform(colours, rows)
        look_up_codes(looked_up, colours, out[place].numpy())

    side_by_side(frame, range(batch), torch.get_num_threads())
    return out.permute(0, 3, 1, 2)
