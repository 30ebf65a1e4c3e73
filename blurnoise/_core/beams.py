"""Beams of headlamps, by which pictures have planes of light: what a beam adds to the light on each pixel, lux."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

from torch import Tensor

from blurnoise._core.checks import LIMITS, an_instance, image_batch, one_of

Beam = Literal["low", "high"]
BEAMS: tuple[Beam, ...] = get_args(Beam)
BeamPlanes = Mapping[str, Tensor]
"""A plane of lux for each beam that a picture knows the light of."""


def checked_planes(name: str, planes: BeamPlanes, *shapes: tuple[int, ...]) -> dict[str, Tensor]:
    """Planes, lux >= 0, of one of these shapes, by beam. Raises ``TypeError`` or ``ValueError``.

    >>> import torch
    >>> checked_planes("headlamp_lux", {"low": torch.full((1, 1, 4, 6), 20.0)}, (1, 1, 4, 6)).keys()
    dict_keys(['low'])
    >>> checked_planes("headlamp_lux", {"low": torch.zeros(1, 1, 4, 6)}, (1, 1, 8, 8))
    Traceback (most recent call last):
    ValueError: headlamp_lux['low']: shape is (1, 1, 4, 6); must be (1, 1, 8, 8)
    """
    an_instance(name, planes, Mapping)
    most = LIMITS["illuminance_lux"].high
    for beam, plane in planes.items():
        one_of(name, beam, BEAMS)
        of_beam, must = f"{name}[{beam!r}]", " or ".join(map(str, dict.fromkeys(shapes)))
        image_batch(of_beam, plane, str(shapes[0]))
        if plane.shape not in shapes:
            raise ValueError(f"{of_beam}: shape is {tuple(plane.shape)}; must be {must}")
        low, high = map(float, plane.detach().aminmax())
        if low < 0 or high > most:
            raise ValueError(f"{of_beam}: values span [{low:g}, {high:g}] lux; must lie within [0, {most:g}]")
    return dict(planes)
