"""Sharpening of a camera, from a slanted edge as it delivers it.

Domain: pictures of 8 bits, (H, W, 3), that one edge crosses; levels are luma, DN. The edge is simulated without
noise, with a Gaussian blur of the lens, and strength and limit of an unsharp mask; those with which its spread along
the normal is the captured one's are the camera's. Weak sharpening of a blurred edge looks like less blur, and is
none; a limit that cuts most of the overshoot hides the strength.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from blurnoise.camera import Camera
from blurnoise.camera.isp import Sharpening
from blurnoise.metrics import SlantedEdge, slanted_edge
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise.scene.take import TakeOptions, take_each
from blurnoise_eval.calibration.frames import Floats

Picture = NDArray[np.uint8]
_SIDE_PX, _BORDER_PX = 96, 8  # of the simulated edge; what the lens's and the mask's border may reach
_ALONG_PX = np.arange(-6, 6.01, 0.25)
_LIMIT_DN = 40.0  # unit of the search
_STARTS = (0.7, 0.5), (0.9, 1.5)
"""Sigma of the lens in px, and strength."""
_UNSHARPENED = 0.0, 255.0 / _LIMIT_DN
"""Strength and limit, in 40 DN, of what is not searched for."""
_OPTIONS = {"xatol": 0.01, "fatol": 1e-3, "maxfev": 80}
_BETTER_DN = 0.1  # RMS by which a further figure must explain the edge better


def sharpening_of(
    picture: Picture, camera: Camera, gain_db: float, lux_of: Callable[[float], float]
) -> Sharpening:
    """The sharpening with which ``camera``, without it, delivers this edge at a gain.

    lux_of: the light in which it delivers a grey of 50 % with a level. Raises ``ValueError`` where there is no edge.
    """
    seen = _edge(picture)
    if not seen.esf.numel():
        reasons = ", ".join(flag.value for flag in seen.flags)
        raise ValueError(f"edge: must be one slanted edge from border to border; {reasons}")
    lux, darker = lux_of(seen.bright), lux_of(seen.dark)
    turn = math.radians(seen.angle_deg)
    y, x = np.mgrid[:_SIDE_PX, :_SIDE_PX] + (1 - _SIDE_PX) / 2
    across = torch.from_numpy(x * math.cos(turn) - y * math.sin(turn))

    def off_dn(sigma_px: float, strength: float, limit_dn: float) -> float:
        step = torch.special.ndtr(across / max(sigma_px, 0.2))
        light = 0.5 * (darker / lux + (1 - darker / lux) * step)
        steps = Sharpening(gain_db, min(max(strength, 0.0), 10.0), 0.0, min(max(limit_dn, 1.0), 255.0))
        own = camera.with_figures(sharpening=(steps,) if steps.strength else ())
        at = Exposure(own, 0.01, lux, gain_db=gain_db)
        (frames,) = take_each(
            Scene(light.float()[None, None]), [at], TakeOptions(wanted=("8 bit",), noise=False)
        )
        simulated = _edge(frames.images()[0][_BORDER_PX:-_BORDER_PX, _BORDER_PX:-_BORDER_PX])
        if not simulated.esf.numel():
            return 255.0
        return float(np.sqrt(np.mean((_spread(simulated) - _spread(seen)) ** 2)))

    def nearest(*start: float) -> Any:
        def off(found: Floats) -> float:
            values: list[float] = found.tolist()
            sigma_px, strength, limit = [*values, *_UNSHARPENED[len(values) - 1 :]]
            return off_dn(sigma_px, strength, limit * _LIMIT_DN)

        return minimize(off, np.array(start), method="Nelder-Mead", options=_OPTIONS)

    best = nearest(0.7)
    sharp = min((nearest(*start) for start in _STARTS), key=lambda found: float(found.fun))
    limited = nearest(*sharp.x.tolist(), 0.5)
    for further in (sharp, limited):  # strength, and a limit, where they surely explain more
        best = further if best.fun - further.fun > _BETTER_DN else best
    found: list[float] = best.x.tolist()
    strength, limit = [*found[1:], *_UNSHARPENED[len(found) - 1 :]]
    limit_dn = round(min(max(limit * _LIMIT_DN, 1.0), 255.0), 1)
    return Sharpening(gain_db, round(min(max(strength, 0.0), 10.0), 2), limit_dn=limit_dn)


def _edge(picture: Picture) -> SlantedEdge:
    grey = picture.ndim == 2 or picture.shape[2] == 1
    luma = picture if grey else cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
    numbers = torch.from_numpy(luma.reshape(1, *luma.shape[:2]).astype(float))
    found = slanted_edge(numbers, full_scale=255.0, bootstrap=0)
    return found[0] if isinstance(found, list) else found


def _spread(edge: SlantedEdge) -> Floats:
    return np.asarray(np.interp(_ALONG_PX, edge.distance_px, edge.esf, left=edge.dark, right=edge.bright))
