"""A picture in the light of headlamps: its scenes by lens and beam, and the facts that the report tells of it.

Domain: linear light, 1 is white; planes X in lux (:mod:`blurnoise.light.headlit`); m, cd/m2. Facts of a picture do
not depend on the beam: where its targets stand, and how bright their white and the background are in it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.luminance import LUMINANCE
from blurnoise.blur.layer import Layer
from blurnoise.camera import Camera
from blurnoise.light.headlamps import BEAMS, Headlamps
from blurnoise.light.headlit import HeadlitPicture, HeadlitTarget, headlit
from blurnoise_eval.datasets import Picture, outlines
from blurnoise_eval.plan.exposure_settings import ExposureSettings

_MOST_TARGETS = 100  # of a picture, of which facts are noted
_LONGEST_TEXT = 18_000


class StandingTarget(NamedTuple):
    """What is noted of a target: its class, place (m right, ahead and up, of its middle), and white in the picture.

    nearer: it is lit as at 8 m; cut_off: its box reaches the picture's side; outlined: its outline is known.
    """

    label: str
    right_m: float
    ahead_m: float
    up_m: float
    white: float
    nearer: bool
    cut_off: bool
    outlined: bool

    @classmethod
    def of(cls, target: HeadlitTarget) -> StandingTarget:
        """What is noted of a target in headlamps."""
        at, outline = target.standing, target.outline
        up = float(at.up_m(np.array([(outline.box_xyxy[1] + outline.box_xyxy[3]) / 2]))[0])
        right, ahead, up, white = (round(number, 4) for number in (at.right_m, at.ahead_m, up, target.white))
        return cls(outline.label, right, ahead, up, white, target.nearer, target.cut_off, outline.outlined)


class HeadlitFacts(NamedTuple):
    """What is noted of a picture: the mean luminance of its background, 1 is white, and its targets of known size.

    unknown: how many targets have none.

    >>> HeadlitFacts.read('[0.2, 1, [["stop sign", 3.0, 50.0, 2.2, 0.34, false, false, true]]]').targets[0].ahead_m
    50.0
    """

    background: float
    unknown: int
    targets: tuple[StandingTarget, ...]

    @property
    def text(self) -> str:
        """As JSON, for the run's file."""
        some = list(self.targets[:_MOST_TARGETS])
        while len(text := json.dumps([round(self.background, 5), self.unknown, some])) > _LONGEST_TEXT:
            some = some[: len(some) // 2]  # of classes with long names
        return text

    @classmethod
    def read(cls, text: str) -> HeadlitFacts:
        """The facts of a run's file, which may be anybody's. Raises ``ValueError``."""
        try:
            background, unknown, rows = json.loads(text)
            targets = tuple(StandingTarget(*row) for row in rows)
            numbers = [background, unknown, *(number for row in targets for number in row[1:])]
            plain = all(isinstance(number, int | float) and math.isfinite(number) for number in numbers)
            if not plain or not all(isinstance(row.label, str) for row in targets):
                raise ValueError
            if not all(0.1 <= row.ahead_m <= 1e6 and abs(row.right_m) <= 1e6 for row in targets):
                raise ValueError
            if not all(abs(row.up_m) <= 1e6 and 0 < row.white <= 1e6 for row in targets):
                raise ValueError
        except (TypeError, ValueError, RecursionError):
            raise ValueError("is no list of targets in headlamps") from None
        return cls(float(background), int(unknown), targets)


class HeadlitScenes:
    """A picture's targets in headlamps, reckoned once for each lens and beam."""

    def __init__(self, plan: ExposureSettings, picture: Picture | None) -> None:
        self._plan, self._picture = plan, picture
        self._found: dict[Any, HeadlitPicture] = {}

    def of(self, light: Tensor, camera: Camera, beam: str) -> HeadlitPicture:
        """The targets of the picture's light (1, C, H, W) in a beam; none of a picture without labels."""
        key = camera.field, beam
        if key not in self._found:
            size = (light.shape[-2], light.shape[-1])
            view = self._plan.lit.view(camera, self._plan.vehicle)
            lamps = Headlamps(BEAMS[BEAMS.index(beam)])
            targets = [] if self._picture is None else outlines(self._picture, size)
            self._found[key] = headlit(light, targets, view, lamps)
        return self._found[key]

    def facts(self, light: Tensor, camera: Camera) -> HeadlitFacts:
        """What is noted of the picture."""
        picture = self.of(light, camera, self._plan.beams[0])
        targets = tuple(StandingTarget.of(each) for each in picture.targets if each is not None)
        weights = light.new_tensor(
            LUMINANCE if light.shape[1] == 3 else [1 / light.shape[1]] * light.shape[1]
        )
        luminance = (light[0] * weights[:, None, None]).sum(0)
        covered = replace(picture, wall=None).plane()[0, 0] > 0
        behind = luminance[~covered]
        mean = float(behind.mean()) if behind.numel() else 0.0
        return HeadlitFacts(mean, len(picture.targets) - len(targets), targets)


def headlit_layers(
    layers: Sequence[Layer], targets: Sequence[int], picture: HeadlitPicture, beam: str
) -> Iterator[Layer]:
    """Layers, cut out of a picture, in its light of headlamps. targets: the place of each layer's target."""
    for layer, place in zip(layers, targets, strict=True):
        (left, top), (height, width) = layer.place_px, layer.alpha.shape
        found = picture.targets[place]
        if found is not None:
            plane = found.lux(top, height)[:, None] * np.ones(width)
        elif picture.wall is not None:
            rows, columns = (
                np.clip(np.arange(count) + first, 0, most - 1)
                for count, first, most in zip((height, width), (top, left), picture.size, strict=True)
            )
            plane = picture.wall[np.ix_(rows, columns)]
        else:
            plane = np.zeros((height, width))
        yield replace(layer, headlamp_lux={beam: torch.from_numpy(plane)[None].to(layer.light)})
