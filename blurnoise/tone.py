"""Tone curves: linear light to the coded values of a picture, both in [0, 1].

"srgb": IEC 61966-2-1. "filmic": an S-curve on top of it, 3 v^2 - 2 v^3 of the coded value v, as Brooks et al.,
Unprocessing Images for Learned Raw Denoising, CVPR 2019, assume of photographs. One's own: points (light, value),
straight lines between them.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import shown
from blurnoise.encoding import srgb_from_linear

Points = tuple[tuple[float, float], ...]
ToneCurve = Literal["srgb", "filmic"] | Points
_MUST = "must be 'srgb', 'filmic' or points (light, value)"


def checked(value: object) -> ToneCurve:
    """A tone curve. Raises ``TypeError`` or ``ValueError`` for no curve from light 0 to 1 that never falls."""
    if isinstance(value, str):
        if value not in ("srgb", "filmic"):
            raise ValueError(f"tone = {shown(value)}: {_MUST}")
        return value  # type: ignore[return-value]
    try:
        points = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"tone = {shown(value)}: {_MUST}") from None
    if points.ndim != 2 or points.shape[1] != 2 or not 2 <= len(points) <= 1 << 16:
        raise ValueError(f"tone = {shown(value)}: {_MUST}, at least two")
    light, values = points.T
    inside = bool(((points >= 0) & (points <= 1)).all())
    rises = bool((np.diff(light) > 0).all() and (np.diff(values) >= 0).all())
    if not (inside and rises and light[0] == 0 and light[-1] == 1):
        raise ValueError(
            f"tone = {shown(value)}: light must increase from 0 to 1, values lie in [0, 1] and never fall"
        )
    return tuple((float(at), float(coded)) for at, coded in points)


def coded(light: Tensor, curve: ToneCurve) -> Tensor:
    """``light``, any shape, clamped to [0, 1] and coded; differentiable."""
    if curve == "srgb":
        return srgb_from_linear(light)
    if curve == "filmic":
        value = srgb_from_linear(light)
        return value * value * (3 - 2 * value)
    at, values = light.new_tensor(curve).unbind(-1)
    light = light.clamp(0.0, 1.0)
    last = torch.searchsorted(at[1:-1].contiguous(), light.detach().contiguous(), right=True)
    slope = values.diff() / at.diff()
    return values[last] + slope[last] * (light - at[last])
