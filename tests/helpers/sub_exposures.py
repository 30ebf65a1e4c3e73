"""Truth by brute force: an exposure as the mean of many moments, each with everything where it is then."""

import math

import numpy as np
import torch

from blurnoise.camera.colour import srgb_from_linear


def moved(plane, x, y):
    """A plane (..., H, W) that wraps round, displaced by Lanczos' kernel of six lobes."""
    return _along(_along(plane, x, -1), y, -2)


def _along(plane, shift, dim):
    if shift == 0:
        return plane
    whole = math.floor(shift)
    taps = np.arange(-5, 7)
    weights = np.sinc(taps - (shift - whole)) * np.sinc((taps - (shift - whole)) / 6)
    weights /= weights.sum()
    return sum(
        float(w) * torch.roll(plane, int(whole + tap), dim) for tap, w in zip(taps, weights, strict=True)
    )


def exposure(background, objects, background_px=(0.0, 0.0), moments=128):
    """The mean light of (C, H, W), before it objects (light, alpha, displacement) of the picture's size."""
    total = torch.zeros_like(background)
    for moment in range(moments):
        t = (moment + 0.5) / moments - 0.5
        seen = moved(background, *(t * along for along in background_px))
        for light, alpha, displacement in objects:
            x, y = (t * along for along in displacement)
            seen = moved(light * alpha, x, y) + (1 - moved(alpha, x, y).clamp(0, 1)) * seen
        total += seen
    return total / moments


def rms_dn(one, other):
    """Root of the mean squared difference of two pictures in linear light, in 8-bit sRGB numbers."""
    return 255 * float((srgb_from_linear(one) - srgb_from_linear(other)).square().mean().sqrt())
