"""Checks of user input: every message names the parameter, the value it got and what is allowed.

Physical limits are one table, the same for every function. Fields of dataclasses: :mod:`blurnoise._core.fields`.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensor

Numbers = float | Tensor | Iterable[float]
"""A number, or one number per image of a batch."""


class Limit(NamedTuple):
    """Range from low to high, both included; above: low itself is excluded.

    >>> LIMITS["tolerance_dn"]  # 0 itself is excluded
    Limit(low=0.0, high=65536.0, above=True)
    """

    low: float
    high: float
    above: bool = False


ABSOLUTE_ZERO_C = -273.15
_REAL = {torch.float16, torch.bfloat16, torch.float32, torch.float64}
_REAL |= {torch.uint8, torch.int8, torch.int16, torch.int32, torch.int64}
"""Types that PyTorch can compute with."""
_LIMITS = {
    # conditions
    "exposure_s start_s": Limit(0.0, 3600.0),
    "illuminance_lux": Limit(0.0, 1e9),  # 10 000 suns
    "velocity_px_s": Limit(-1e7, 1e7),
    "speed_px_s": Limit(0.0, 1e7),
    "displacement_px": Limit(-1e5, 1e5),  # transforms of such lengths are still fast
    "shake_px": Limit(0.0, 1e4),
    "variation_px": Limit(0.0, 1e6),
    "direction_deg angle_deg": Limit(-1e6, 1e6),  # to a tenth of a degree in single precision
    "temperature_c": Limit(ABSOLUTE_ZERO_C, 300.0),
    "gain_db": Limit(-120.0, 120.0),
    "tolerance_dn": Limit(0.0, 65536.0, above=True),
    "white_e": Limit(0.0, 1e32),  # electrons of white, or per photon
    # lenses and blurs
    "focal_px": Limit(0.0, 1e9, above=True),
    "coefficient centre_px": Limit(-1e6, 1e6),
    "radius_px defocus_radius_px gaussian_sigma_px diffraction_lambda_n_px": Limit(0.0, 1000.0),
    # roads
    "speed_m_s": Limit(0.0, 3e8),
    "ego_kmh": Limit(0.0, 360.0),  # as of sweeps
    "distance_m target_width_m depth_m": Limit(1e-6, 1e9),
    "width_px": Limit(1.0, 1 << 20),
    "hfov_deg": Limit(1e-3, 360.0),
    "velocity_m_s": Limit(-3e8, 3e8),
    "rotation_deg_s": Limit(-1e5, 1e5),
    "camera_height_m": Limit(0.0, 1e6, above=True),
    "pitch_deg": Limit(-90.0, 90.0),
    "heading_deg": Limit(-360.0, 360.0),
    "blur_px": Limit(0.0, 1e5, above=True),
    # charts and their measurement
    "size_px": Limit(0.01, 1 << 14),
    "height_px cycles": Limit(1, 1 << 14),
    "supersample": Limit(1, 64),
    "contrast": Limit(0.0, 1e6, above=True),
    "data_range": Limit(0.0, 1e30, above=True),
    "target_px": Limit(1, 128),
    "bootstrap": Limit(0, 100_000),
    # captures, lamps and spectra
    "exposure_ratio sensitivity": Limit(1e-6, 1e6),
    "frequency_hz lamp_hz": Limit(1e-3, 1e9),
    "lamp_duty": Limit(0.0, 1.0, above=True),
    "phase_rad": Limit(-1e6, 1e6),
    "kelvin": Limit(300.0, 1e6),
    "wavelength_nm": Limit(1.0, 1e6),
    "value": Limit(0.0, 1e30),  # of a curve, either sign
}
LIMITS: Mapping[str, Limit] = {name: limit for names, limit in _LIMITS.items() for name in names.split()}
"""By the argument's name, in its unit: beyond anything that is built or seen, and within what single precision and
bounded time and memory can do. Figures of cameras have theirs where they are defined, in the records of
``blurnoise.camera``."""
LARGEST_PICTURE = 1 << 28
"""Pixels of a picture that is made."""
DRAWN_FROM: Mapping[str, float] = {"exposure_s": 1e-9, "illuminance_lux": 1e-6, "white_e": 1e-3}
"""The least that is drawn log-uniformly: from there to the limit single precision holds the ratio."""


class OutOfRange(ValueError):
    """A number that is not within [low, high] or, where that is ``above`` it, (low, high].

    >>> str(OutOfRange("duty", 1.5, 0.0, 1.0, above=True))
    'duty = 1.5: must be finite and > 0 and <= 1'
    """

    def __init__(self, name: str, value: object, low: float, high: float, above: bool = False) -> None:
        super().__init__(name, value, low, high, above)  # for pickle
        self.name, self.value, self.low, self.high, self.above = name, value, low, high, above

    def __str__(self) -> str:
        return (
            f"{self.name} = {shown(self.value)}: must be finite{bounds_text(self.low, self.high, self.above)}"
        )


def limited(name: str, value: float, entry: str | None = None) -> float:
    """``value`` as a float. Raises ``TypeError`` or ``ValueError`` outside the limit of its name, or of ``entry``.

    >>> limited("gain_db", 200)
    Traceback (most recent call last):
    blurnoise._core.checks.OutOfRange: gain_db = 200: must be finite and >= -120 and <= 120
    """
    low, high, above = LIMITS[entry or name]
    return in_range(name, value, low, high, above=above)


def in_range(
    name: str, value: float, low: float = -math.inf, high: float = math.inf, *, above: bool = False
) -> float:
    """``value``, finite, as a float. Raises ``TypeError``, or ``ValueError`` unless ``low <= value <= high``; above:
    unless ``low < value``.

    >>> in_range("share", np.float32(0.25), 0.0, 1.0)
    0.25
    """
    number = value
    if type(value) is not float:  # as nearly every number is
        try:
            tensor = value if isinstance(value, Tensor) else None
            unreal = tensor is not None and (
                _without_values(tensor) or tensor.dtype not in _REAL or tensor.ndim > 1
            )
            if unreal or isinstance(value, (str, bytes, bool, np.bool_)):
                raise TypeError
            number = float(value)
        except OverflowError:  # an integer beyond 1e308
            number = math.inf
        except (TypeError, ValueError, RuntimeError):
            raise TypeError(f"{name} = {shown(value)}: must be a number") from None
    if not -math.inf < number < math.inf or number < low or number > high or (above and number == low):
        raise OutOfRange(name, value, low, high, above)
    return number


def counted(name: str, value: int, entry: str | None = None) -> int:
    """``value``, an integer within the limit of its name, or of ``entry``. Raises as :func:`integer` does.

    >>> counted("bootstrap", 200)
    200
    """
    low, high, _ = LIMITS[entry or name]
    return integer(name, value, int(low), int(high))


def integer(name: str, value: int, low: int, high: int) -> int:
    """``value`` as an int, NumPy's too. Raises ``TypeError`` for no integer, ``ValueError`` outside [low, high].

    >>> integer("seed", True, 0, 10)
    Traceback (most recent call last):
    TypeError: seed = True: must be an integer
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} = {shown(value)}: must be an integer")
    if not low <= value <= high:
        raise ValueError(f"{name} = {shown(value)}: must be >= {low} and <= {high}")
    return int(value)


def picture_size(name: str, value: object) -> tuple[int, int]:
    """Return (height, width). Raises ``ValueError`` unless they are two integers from 1 to 2^20.

    >>> picture_size("size", [480, 640])
    (480, 640)
    """
    try:
        height, width = (integer(name, side, 1, 1 << 20) for side in cast(tuple[int, int], value))
    except (TypeError, ValueError):
        must = "must be (height, width), two integers from 1 to 1048576"
        raise ValueError(f"{name} = {shown(value)}: {must}") from None
    if height * width > LARGEST_PICTURE:
        raise ValueError(f"{name} = {shown(value)}: must be at most {LARGEST_PICTURE} pixels")
    return height, width


def boxes(name: str, value: object) -> Tensor:
    """Return boxes (N, 4) as floats. Raises ``TypeError`` or ``ValueError`` for anything else, NaN and infinity.

    >>> boxes("boxes", [[0, 0, 20, 10]]).shape
    torch.Size([1, 4])
    """
    tensor = real_tensor(name, value)
    if tensor.ndim != 2 or tensor.shape[1] != 4:
        raise ValueError(f"{name}: shape must be (N, 4), got {tuple(tensor.shape)}")
    return finite(name, tensor if tensor.dtype in (torch.float32, torch.float64) else tensor.float())


def an_instance(name: str, value: object, kind: type) -> None:
    """Raise ``TypeError`` unless ``value`` is a ``kind``.

    >>> an_instance("image", [0.5], Tensor)
    Traceback (most recent call last):
    TypeError: image: must be a torch.Tensor, got list
    """
    if not isinstance(value, kind):
        must = f"{kind.__module__.partition('.')[0]}.{kind.__name__}".removeprefix("builtins.")
        raise TypeError(f"{name}: must be a {must}, got {type(value).__name__}")


def one_of(name: str, value: str, allowed: Iterable[str]) -> str:
    """``value``. Raises ``ValueError`` unless it is one of ``allowed``.

    >>> one_of("border", "mirror", ("reflect", "circular"))
    Traceback (most recent call last):
    ValueError: border = 'mirror': must be one of 'reflect', 'circular'
    """
    choices = list(allowed)
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} = {shown(value)}: must be one of {', '.join(map(repr, choices))}")
    return value


def known(what: str, name: object, names: Collection[str]) -> None:
    """Raise ``ValueError`` that suggests the nearest of ``names`` unless ``name`` is among them.

    >>> known("field", "f_numbr", ["f_number", "hfov_deg"])
    Traceback (most recent call last):
    ValueError: field 'f_numbr' is unknown (did you mean 'f_number'?); must be one of f_number, hfov_deg
    """
    if not isinstance(name, str) or name not in names:
        near = get_close_matches(name[:99], names, n=1) if isinstance(name, str) else []
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise ValueError(f"{what} {shown(name)} is unknown{hint}; must be one of {', '.join(sorted(names))}")


def image_batch(name: str, value: Tensor, shape: str = "(B, C, H, W)") -> Tensor:
    """``value``, float32 or float64 of this shape without NaN or infinity. Raises ``TypeError`` or ``ValueError``.

    >>> image_batch("image", torch.zeros(3, 4, 6))
    Traceback (most recent call last):
    ValueError: image: shape must be (B, C, H, W), none of them 0, got (3, 4, 6)
    """
    return finite(name, batch_shaped(name, value, shape))


def batch_shaped(name: str, value: Tensor, shape: str = "(B, C, H, W)") -> Tensor:
    """:func:`image_batch` without a check of the values.

    >>> batch_shaped("image", torch.zeros(1, 3, 4, 6, dtype=torch.uint8))
    Traceback (most recent call last):
    TypeError: image: must be float32 or float64 (integers over full scale; ...), got torch.uint8
    """
    if not isinstance(value, Tensor):
        raise TypeError(f"{name}: must be a torch.Tensor of shape {shape}, got {type(value).__name__}")
    dense(name, value)
    if value.dtype not in (torch.float32, torch.float64):
        must = "must be float32 or float64 (integers over full scale; half precision holds no full well's electrons)"
        raise TypeError(f"{name}: {must}, got {value.dtype}")
    if value.ndim != shape.count(",") + 1 or 0 in value.shape:
        raise ValueError(f"{name}: shape must be {shape}, none of them 0, got {tuple(value.shape)}")
    return value


def finite(name: str, value: Tensor) -> Tensor:
    """``value``, a float32 or float64 tensor. Raises ``ValueError`` where it holds NaN or infinity.

    >>> finite("image", torch.tensor([1.0, torch.nan]))
    Traceback (most recent call last):
    ValueError: image: contains NaN or Inf
    """
    # A sum is finite where all its values are, in one pass without a mask; it may also overflow, hence the second
    # test. NumPy's sum wakes no threads.
    plain = value.detach()
    with np.errstate(all="ignore"):
        total = plain.sum() if plain.device.type != "cpu" else plain.numpy().sum()
    if not math.isfinite(float(total)) and not bool(torch.isfinite(plain).all()):
        raise ValueError(f"{name}: contains NaN or Inf")
    return value


def limited_per_image(name: str, value: Numbers, batch: int, like: Tensor) -> Tensor:
    """``value``, one number or one per image within the limit of its name, as a tensor (batch,) of ``like``'s kind.

    Gradients pass. Raises ``TypeError``, and ``ValueError`` outside the limit or for neither 1 nor ``batch`` numbers.

    >>> limited_per_image("exposure_s", 0.01, batch=3, like=torch.zeros(1))
    tensor([0.0100, 0.0100, 0.0100])
    """
    if isinstance(value, (int, float)):  # the common case, without a tensor operation per check
        return torch.full((batch,), limited(name, value), dtype=like.dtype, device=like.device)
    tensor = real_tensor(name, value)
    if tensor.ndim > 1 or (tensor.ndim == 1 and tensor.shape[0] not in (1, batch)):
        raise ValueError(f"{name}: must be a number or {batch} numbers, got shape {tuple(tensor.shape)}")
    low, high, _ = LIMITS[name]
    plain: Any = tensor.detach()
    if plain.device.type == "cpu" and plain.dtype in (torch.float32, torch.float64):
        plain = plain.numpy()  # faster for a few numbers
    if not bool(((plain >= low) & (plain <= high) & (abs(plain) < math.inf)).all()):
        raise OutOfRange(name, value, low, high)
    return tensor.to(device=like.device, dtype=like.dtype).expand(batch)


def limited_motion(name: str, motion: Tensor) -> None:
    """Raise ``ValueError`` unless vectors are within the limit of their name, else of displacement_px, or a rounding
    beyond it.

    >>> limited_motion("displacement_px", torch.tensor([3e4, 0.0]))  # raises beyond 1e5 px
    """
    most, moved = LIMITS.get(name, LIMITS["displacement_px"]).high, motion.detach()
    if not bool((moved.abs() <= most * (1 + 1e-6)).all()):
        longest = moved if moved.numel() <= 2 else moved.flatten()[moved.abs().argmax()]
        raise OutOfRange(name, longest, -most, most)


def real_tensor(name: str, value: object) -> Tensor:
    """``value``, a tensor of real numbers as it is, anything else as float64. Raises ``TypeError``.

    >>> real_tensor("boxes", [[1, 2]]).dtype
    torch.float64
    """
    try:
        tensor = value if isinstance(value, Tensor) else torch.as_tensor(value, dtype=torch.float64)
    except OverflowError:  # an integer beyond 1e308
        raise ValueError(f"{name} = {shown(value)}: must be finite") from None
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"{name} = {shown(value)}: must be numbers") from None
    dense(name, tensor)
    if tensor.is_complex() or tensor.dtype == torch.bool:
        raise TypeError(f"{name}: must be real numbers, got {tensor.dtype}")
    return tensor if tensor.dtype in _REAL else tensor.double()


def dense(name: str, tensor: Tensor) -> None:
    """Raise ``TypeError`` for a tensor without values (meta, fake), or that stores them otherwise (sparse).

    >>> dense("image", torch.zeros(3, device="meta"))
    Traceback (most recent call last):
    TypeError: image: must be a dense tensor with values, got a meta tensor
    """
    if kind := _without_values(tensor):
        raise TypeError(f"{name}: must be a dense tensor with values, got a {kind} tensor")


def _without_values(tensor: Tensor) -> str:
    kinds = {
        "nested": tensor.is_nested,
        "fake": isinstance(tensor, FakeTensor),
        "meta": tensor.is_meta,
        "quantised": tensor.is_quantized,
        str(tensor.layout): tensor.layout != torch.strided,
        "negative view": tensor.device.type == "cpu" and tensor.is_neg(),
    }
    return next((kind for kind, applies in kinds.items() if applies), "")


def bounds_text(low: float, high: float, above: bool = False) -> str:
    """What follows "must be finite" in a message.

    >>> bounds_text(0, math.inf, above=True), bounds_text(0, 1)
    (' and > 0', ' and >= 0 and <= 1')
    """
    least = f" and {'>' if above else '>='} {low:g}" if low > -math.inf else ""
    return least + (f" and <= {high:g}" if high < math.inf else "")


def shown(value: object) -> str:
    """The value in a message: on one line of at most 120 characters, however large it is inside.

    >>> shown([1.0] * 1000)
    '[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, ...]'
    """
    if isinstance(value, Tensor):
        kind = _without_values(value)
        value = (
            f"{kind} tensor {tuple(value.shape)}" if kind and not value.is_nested else kind or value.tolist()
        )
    text = " ".join(_SHORT.repr(value).split())
    return text if len(text) <= 120 else f"{text[:117]}..."


class _Short(reprlib.Repr):
    """Cuts what is large before it is written: Python refuses to write integers of 4300 digits."""

    def repr_int(self, value: int, level: int) -> str:
        few = value.bit_length() <= 10_000
        return super().repr_int(value, level) if few else f"<integer of {value.bit_length()} bits>"


_SHORT = _Short()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 3, 100, 100
