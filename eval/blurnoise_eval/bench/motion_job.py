"""Jobs of the bench of moving things: a picture, the truth of what a camera would see of it, and ways to get there.

Domain: linear light, white is 1, three channels. Convention: px, x right, y down. Calls take a case and return what
is timed: a call without arguments whose picture is (1, C, H, W) or, as OpenCV has it, (H, W, C).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.bench.motion_truth import Floats

Picture = NDArray[np.float32]
Call = Callable[[], Tensor | Picture]
OURS = "ours"
"""The family of our methods; the one of that name is what others are compared with."""
EXPOSURE_S = 0.01


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    sign_px, moved_px: size and motion of the object; the hand's shake extends over moved_px, too. moments: of the
    truth's exposure. A call is repeated from ``fewest`` to ``most`` times, as often as fits into ``seconds``.
    """

    height_px: int = 720
    width_px: int = 1280
    sign_px: int = 64
    moved_px: float = 32.0
    moments: int = 256
    fewest: int = 3
    most: int = 12
    seconds: float = 3.0

    @property
    def values(self) -> int:
        """Of a picture."""
        return 3 * self.height_px * self.width_px


@dataclass(frozen=True)
class Case:
    """picture: (1, C, H, W) float32 as at mid-exposure, nothing moving. truth: (C, h, w), of its rows and columns."""

    picture: Tensor
    truth: Floats
    rows: slice
    columns: slice

    @cached_property
    def pixels(self) -> Picture:
        """The picture as OpenCV has it, (H, W, C)."""
        return np.ascontiguousarray(self.picture[0].permute(1, 2, 0).numpy())

    def error_dn(self, seen: Tensor | Picture) -> float:
        """RMS difference from the truth where that is known, in 8-bit sRGB numbers."""
        planes = seen[0] if isinstance(seen, Tensor) else torch.from_numpy(seen).permute(2, 0, 1)
        theirs = planes[:, self.rows, self.columns].double()
        codes = [srgb_from_linear(each.clamp(0, 1)) for each in (theirs, torch.from_numpy(self.truth))]
        return 255 * float((codes[0] - codes[1]).square().mean().sqrt())


@dataclass(frozen=True)
class Method:
    """One way to do a job. family: who or what does it, as the chart shows it; mark: which of the family."""

    name: str
    family: str
    about: str
    of: Callable[[Any], Call]
    mark: str = ""


@dataclass(frozen=True)
class Job:
    """What is to be done, a case of it, and the ways, ours first. absent: who could not take part, and why."""

    name: str
    title: str
    case: Callable[[Extent], Case]
    methods: tuple[Method, ...]
    absent: dict[str, str] = field(default_factory=dict)
