"""Bench of the chain: ``simulate`` of a batch with motion and noise, beside as many standard normal numbers.

Units: errors in digital numbers of a converter of 12 bits, RMS, of the frames without noise and rounding, against
``fidelity="full"`` in double precision: they hold what the chain leaves out, and its rounding. Parts of the chain,
each alone, show where its time goes.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import torch
from torch import Tensor

from blurnoise import Camera, Scene, motion_blur, photoelectrons, simulate
from blurnoise._core import rng
from blurnoise.camera.colour import linear_from_srgb
from blurnoise.sensor.readout import read_out
from blurnoise_eval.bench.contest import Case, Contender, Contest

SHAPE = (8, 3, 512, 512)
_MOTIONS_PX = (
    ("31 px at 21 degrees", (29.0, 11.0)),
    ("31 px along rows", (31.0, 0.0)),
    ("at rest", (0.0, 0.0)),
)
_EXPOSURE_S = 0.01
_WAYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("simulate, tolerance_dn = 0.1", {}),
    ("simulate, tolerance_dn = 0.001", {"tolerance_dn": 0.001}),
    ('simulate, fidelity = "full"', {"fidelity": "full"}),
)


def chain(*, quick: bool) -> Contest:
    """``torch.randn`` first, to whose time the others are related."""
    cases = [partial(moved, *each, SHAPE) for each in (_MOTIONS_PX[:1] if quick else _MOTIONS_PX)]
    title = f"simulate beside torch.randn, {'x'.join(map(str, SHAPE))}"
    return Contest("chain", title, cases, error_unit="DN RMS", seconds=6.0)


def moved(name: str, moved_px: tuple[float, float], shape: tuple[int, ...]) -> Case:
    """Random pictures that move so far during the exposure."""
    pictures = torch.rand(shape, generator=torch.Generator().manual_seed(0))
    arguments: dict[str, Any] = {
        "camera": Camera.preset("imx250"), "exposure_s": _EXPOSURE_S, "illuminance_lux": 60.0,
        "velocity_px_s": [along / _EXPOSURE_S for along in moved_px], "generator": list(range(len(pictures))),
    }  # fmt: skip
    mean: dict[str, Any] = {"noise": False, "quantised": False}
    exact: Tensor = simulate(pictures.double(), **arguments, **mean, fidelity="full")

    def taken(options: dict[str, Any]) -> dict[str, Any]:
        simulate(pictures, **arguments, **options)
        return options

    def error_dn(options: Any) -> float | None:
        if not isinstance(options, dict):
            return None
        return float((simulate(pictures, **arguments, **mean, **options) - exact).square().mean().sqrt())

    light, seeds = linear_from_srgb(pictures), arguments["generator"]
    white_e = photoelectrons(arguments["camera"], arguments["illuminance_lux"], _EXPOSURE_S)
    read = partial(
        read_out, light, arguments["camera"], white_e=white_e, exposure_s=_EXPOSURE_S, generator=seeds
    )
    ways = [Contender("torch.randn", partial(torch.randn, shape))]
    ways += [Contender(way, partial(taken, options), True) for way, options in _WAYS]
    ways += [
        Contender("part: sRGB to light", partial(linear_from_srgb, pictures), True),
        Contender("part: checks, brightest light", partial(Scene, light), True),
        Contender("part: blur", partial(motion_blur, light, moved_px), True),
        Contender("part: normal numbers", partial(rng.standard_normal, seeds, light), True),
        Contender("part: read-out without noise", partial(read, noise=False), True),
        Contender("part: read-out with noise", read, True),
    ]
    return Case(name, ways, error_dn)
