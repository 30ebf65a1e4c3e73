"""Values that every metric takes: real tensors, read in double precision."""

from __future__ import annotations

import torch
from torch import Tensor

from blurnoise._core.checks import real_tensor


def real(name: str, value: Tensor, *, dims: int = 0) -> Tensor:
    """Return ``value`` as float64, gradients kept; 8- and 16-bit integers come with their numbers as they are.

    Raises ``TypeError`` unless it is a tensor of real numbers, ``ValueError`` for one that is empty or has
    fewer than ``dims`` dimensions. NaN passes: a batch's good items are not lost to a bad one.
    """
    if not isinstance(value, Tensor):
        raise TypeError(f"{name}: must be a torch.Tensor, got {type(value).__name__}")
    if value.is_complex() or value.dtype == torch.bool:
        raise TypeError(f"{name}: must hold real numbers, got {value.dtype}")
    if value.ndim < dims or 0 in value.shape:
        raise ValueError(f"{name}: must have {dims} or more dimensions, none of 0, got {tuple(value.shape)}")
    return value.double()


def not_negative(name: str, value: float | Tensor, like: Tensor) -> Tensor:
    """:func:`beside`. Raises ``ValueError`` where it is below 0; NaN passes."""
    tensor = beside(name, value, like)
    if bool((tensor.detach() < 0).any()):
        raise ValueError(f"{name}: must be >= 0, the least is {float(tensor.detach().nan_to_num().min()):g}")
    return tensor


def beside(name: str, value: float | Tensor, like: Tensor) -> Tensor:
    """Return ``value`` as float64 on ``like``'s device. Raises ``TypeError``, ``ValueError`` for shapes."""
    tensor = real_tensor(name, value).to(like.device, torch.float64)
    try:
        torch.broadcast_shapes(tensor.shape, like.shape)  # type: ignore[no-untyped-call]
    except RuntimeError:
        raise ValueError(f"{name}: shape {tuple(tensor.shape)} does not fit {tuple(like.shape)}") from None
    return tensor
