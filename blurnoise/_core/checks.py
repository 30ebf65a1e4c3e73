"""Guards for user input: every message names the parameter, the value it got and what is allowed."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from typing import Any

import numpy as np
import torch
from torch import Tensor

Numbers = float | Tensor | Iterable[float]
"""A number, or one number per image of a batch."""


class OutOfRange(ValueError):
    """A number that is not within [low, high] or, where that is ``above`` it, (low, high]."""

    def __init__(self, name: str, value: object, low: float, high: float, above: bool = False) -> None:
        super().__init__(name, value, low, high, above)  # as pickle gives them back
        self.name, self.value, self.low, self.high, self.above = name, value, low, high, above

    def __str__(self) -> str:
        """Name, value and what is allowed."""
        return f"{self.name} = {shown(self.value)}: must be finite{_bounds(self.low, self.high, self.above)}"


def positive(name: str, value: float) -> float:
    """Return ``value`` as a float. Raises ``ValueError`` unless it is finite and > 0."""
    return _number(name, value, low=0.0, strict=True)


def non_negative(name: str, value: float) -> float:
    """Return ``value`` as a float. Raises ``ValueError`` unless it is finite and >= 0."""
    return _number(name, value, low=0.0)


def in_range(name: str, value: float, low: float, high: float, *, above: bool = False) -> float:
    """Return ``value`` as a float. Raises ``ValueError`` unless ``low <= value <= high``; above: low is not."""
    return _number(name, value, low=low, high=high, strict=above)


def integer(name: str, value: int, low: int, high: int) -> int:
    """Return ``value`` as an int; NumPy's count. Raises ``TypeError`` for no integer, ``ValueError`` outside."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} = {shown(value)}: must be an integer")
    if not low <= value <= high:
        raise ValueError(f"{name} = {shown(value)}: must be >= {low} and <= {high}")
    return int(value)


def rectangle(name: str, value: object) -> tuple[int, int, int, int]:
    """Return ``value``, four integers (left, top, width, height), px. Raises ``TypeError``."""
    if (
        not isinstance(value, (tuple, list))
        or len(value) != 4
        or not all(type(side) is int for side in value)
    ):
        raise TypeError(f"{name} = {shown(value)}: must be four integers (x, y, width, height)")
    left, top, width, height = value
    return left, top, width, height


def an_instance(name: str, value: object, kind: type) -> None:
    """Raise ``TypeError`` unless ``value`` is a ``kind``."""
    if not isinstance(value, kind):
        must = f"{kind.__module__.partition('.')[0]}.{kind.__name__}"
        raise TypeError(f"{name}: must be a {must}, got {type(value).__name__}")


def one_of(name: str, value: str, allowed: Iterable[str]) -> str:
    """Return ``value``. Raises ``ValueError`` unless it is one of ``allowed``."""
    choices = list(allowed)
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} = {shown(value)}: must be one of {', '.join(map(repr, choices))}")
    return value


def known(what: str, name: object, names: Collection[str]) -> None:
    """Raise ``ValueError`` that suggests the nearest of ``names`` unless ``name`` is among them."""
    if name not in names:
        near = get_close_matches(name[:99], names, n=1) if isinstance(name, str) else []
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"{what} {shown(name)} is unknown; {hint}Known are {', '.join(names)}")


def image_batch(name: str, value: Tensor) -> Tensor:
    """Return ``value``, a float32 or float64 tensor of shape (B, C, H, W) without NaN or Inf.

    Raises ``TypeError`` for anything else, ``ValueError`` for a wrong shape or value.
    """
    return finite(name, batch_shaped(name, value))


def batch_shaped(name: str, value: Tensor) -> Tensor:
    """:func:`image_batch` without a look at the values."""
    if not isinstance(value, Tensor):
        raise TypeError(f"{name}: must be a torch.Tensor of shape (B, C, H, W), got {type(value).__name__}")
    if value.dtype not in (torch.float32, torch.float64):
        raise TypeError(
            f"{name}: must be float32 or float64, got {value.dtype}; integers are divided by full scale, and "
            "half precision cannot hold a full well's electrons"
        )
    if value.ndim != 4 or 0 in value.shape:
        raise ValueError(f"{name}: shape must be (B, C, H, W), none of them 0, got {tuple(value.shape)}")
    return value


def finite(name: str, value: Tensor) -> Tensor:
    """Return ``value``, a float32 or float64 tensor. Raises ``ValueError`` where it holds NaN or Inf."""
    # A sum is finite where all its values are: one pass without a mask. A sum may also overflow, hence the
    # second look. NumPy's sum wakes no threads, which would then spin beside the work that follows.
    seen = value.detach()
    with np.errstate(all="ignore"):
        total = seen.sum() if seen.device.type != "cpu" else seen.numpy().sum()
    if not math.isfinite(float(total)) and not bool(torch.isfinite(seen).all()):
        raise ValueError(f"{name}: contains NaN or Inf")
    return value


def per_image(
    name: str,
    value: Numbers,
    batch: int,
    like: Tensor,
    *,
    low: float = -math.inf,
    high: float = math.inf,
) -> Tensor:
    """Return ``value``, a number or one number per image, as a tensor of shape (batch,).

    dtype and device are those of ``like``; gradients pass. Raises ``ValueError`` for NaN, Inf, a value
    outside [low, high] or a length that is neither 1 nor ``batch``.
    """
    if isinstance(value, (int, float)):  # the common case, without a tensor operation per check
        number = _number(name, value, low=low, high=high)
        return torch.full((batch,), number, dtype=like.dtype, device=like.device)
    tensor = real_tensor(name, value)
    if tensor.ndim > 1 or (tensor.ndim == 1 and tensor.shape[0] not in (1, batch)):
        raise ValueError(f"{name}: must be a number or {batch} numbers, got shape {tuple(tensor.shape)}")
    seen: Any = tensor.detach()
    if seen.device.type == "cpu" and seen.dtype in (torch.float32, torch.float64):
        seen = seen.numpy()  # which takes a part of the time for a few numbers
    if not bool(((seen >= low) & (seen <= high) & (abs(seen) < math.inf)).all()):
        raise ValueError(f"{name} = {shown(value)}: must be finite{_bounds(low, high)}")
    return tensor.to(device=like.device, dtype=like.dtype).expand(batch)


def real_tensor(name: str, value: object) -> Tensor:
    """``value``, a tensor of real numbers as it is, anything else as float64. Raises ``TypeError``."""
    try:
        tensor = value if isinstance(value, Tensor) else torch.as_tensor(value, dtype=torch.float64)
    except OverflowError:  # an integer beyond 1e308
        raise ValueError(f"{name} = {shown(value)}: must be finite") from None
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"{name} = {shown(value)}: must be numbers") from None
    if tensor.is_complex() or tensor.dtype == torch.bool:
        raise TypeError(f"{name}: must be real numbers, got {tensor.dtype}")
    return tensor


def _number(name: str, value: float, *, low: float, high: float = math.inf, strict: bool = False) -> float:
    try:
        if isinstance(value, (str, bytes, bool, np.bool_)):
            raise TypeError
        number = float(value)
    except OverflowError:  # an integer beyond 1e308
        number = math.inf
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"{name} = {shown(value)}: must be a number") from None
    if not math.isfinite(number) or number < low or number > high or (strict and number == low):
        raise OutOfRange(name, value, low, high, strict)
    return number


def _bounds(low: float, high: float, strict: bool = False) -> str:
    parts = []
    if low > -math.inf:
        parts.append(f"{'>' if strict else '>='} {low:g}")
    if high < math.inf:
        parts.append(f"<= {high:g}")
    return f" and {' and '.join(parts)}" if parts else ""


def shown(value: object) -> str:
    """The value as a message shows it: on one line of at most 120 characters, however large it is inside."""
    text = " ".join(_SHORT.repr(value.tolist() if isinstance(value, Tensor) else value).split())
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


class _Short(reprlib.Repr):
    """What is large is cut before it is written: aliases make a short file hold a billion entries."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, 100, 100

    def repr_int(self, value: int, level: int) -> str:
        return repr(value) if value.bit_length() <= 128 else f"<integer of {value.bit_length()} bits>"


_SHORT, _SHOWN = _Short(), 120
