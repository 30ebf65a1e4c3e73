"""The default camera: in colour for colours and monochrome for grey, with a global shutter.

The reason for a choice is the source of the camera's name, so a run's manifest and page have it.
"""

from __future__ import annotations

import numpy as np
from torch import Tensor

from blurnoise._core import usual
from blurnoise.camera import Camera
from blurnoise.camera.colour import PLANES, Cfa, srgb_from_linear
from blurnoise_eval.datasets import Image, PictureSet, eight_bit, sample

THREE_SENSORS = "imx250"
"""The preset with a sensor for each colour."""
_DEFAULT = "chosen: default, "
_SAMPLED = 8  # pictures that are read
# JPEG moves the colours of a grey picture by a step or two.
_GREY_DN, _COLOURED_SHARE = 2, 0.01  # an overlay or a few damaged pixels do not make a colour camera
_MOST_PX = 256  # of a side: larger pictures are subsampled


def default_camera(*, colour: bool, cfa: Cfa | None = None) -> Camera:
    """The camera of pictures in colour or grey; cfa: filters that the user asks for, in place of its own.

    ``sources["name"]`` says why it is this camera.

    >>> default_camera(colour=True).name, default_camera(colour=False).name
    ('imx250c', 'imx250m')
    """
    name, reason = (usual.COLOUR, "pictures in colour") if colour else (usual.MONOCHROME, "grey pictures")
    if cfa is not None:
        name, reason = THREE_SENSORS if cfa in PLANES else usual.COLOUR, f"cfa = {cfa}"
    camera = Camera.preset(name)
    sources = {**camera.sources, "name": f"{_DEFAULT}{reason}"}
    return camera.with_figures(cfa=cfa or camera.sensor.cfa, sources=sources)


def default_for(pictures: PictureSet, cfa: Cfa | None = None) -> Camera:
    """The camera of a run; some pictures are read to see whether they are in colour.

    >>> from blurnoise_eval import datasets
    >>> default_for(datasets.rendered_signs((50,), count=1)).name  # signs are red
    'imx250c'
    """
    return default_camera(colour=cfa is not None or in_colour(pictures), cfa=cfa)


def in_colour(pictures: PictureSet) -> bool:
    """Whether any of some pictures, evenly spread over the set, is in colour; True if none can be read.

    >>> from blurnoise_eval import datasets
    >>> in_colour(datasets.rendered_signs((50,), count=1))
    True
    """
    some = [image for _, image in sample(pictures, _SAMPLED)]
    return not some or not all(map(is_grey, some))


def is_grey(image: Image) -> bool:
    """Whether the colours of (H, W, C) are the same, within 2 of 255, in all but 1 % of the pixels.

    >>> is_grey(np.full((8, 8, 3), 100, np.uint8)), is_grey(np.zeros((8, 8, 3), np.uint8) + np.uint8([0, 0, 9]))
    (True, False)
    """
    step = max(1, max(image.shape[:2]) // _MOST_PX)
    sampled = eight_bit(image[::step, ::step])
    spread = sampled.max(-1).astype(int) - sampled.min(-1)
    return bool(np.mean(spread > _GREY_DN) <= _COLOURED_SHARE)


def is_grey_light(light: Tensor) -> bool:
    """:func:`is_grey` of linear light (1, C, H, W), after sRGB coding.

    >>> import torch
    >>> is_grey_light(torch.full((1, 3, 8, 8), 0.5))
    True
    """
    coded = srgb_from_linear(light[0].clamp(0.0, 1.0)).mul(255.0).round().byte()
    return is_grey(coded.permute(1, 2, 0).numpy())


def camera_text(camera: Camera, *, colour: bool) -> str | None:
    """A line on the camera of pictures in colour or grey: why it is the default, or that it has three sensors.

    None for a camera that the user named, unless it has a sensor for each colour and the pictures are in colour.

    >>> camera_text(default_camera(colour=False), colour=False)
    'camera: imx250m, the default for grey pictures'
    """
    source = camera.sources.get("name", "")
    reason = source.removeprefix(_DEFAULT) if source.startswith(_DEFAULT) else ""
    if camera.sensor.cfa == "none" and colour:
        return f"camera: {camera.name}, a sensor for each colour: sees far more light than one with filters (Bayer)"
    return f"camera: {camera.name}, the default for {reason}" if reason else None
