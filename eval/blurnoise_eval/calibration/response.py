"""Response of a camera: its tone curve from pictures of one still scene at several exposures, fitted robustly.

Domain: values of 8 bits, (J, N) for J pictures of the same N pixels, exposures in rising order; light is relative, 1
where the values clip. Pixel i of picture j has g(z_ij) = ln E_i + ln T_j, where g is the logarithm of the light of
value z (Debevec & Malik, Recovering High Dynamic Range Radiance Maps from Photographs, SIGGRAPH 1997). Their E_i are
eliminated. The difference of g to that of sRGB is smooth, by its second difference. Residuals count in values, with
Huber's weights (Robust Estimation of a Location Parameter, Annals of Mathematical Statistics 35, 1964), so that
things that moved, edges and noise do not bend the curve. What clips in a JPEG file does not have one value: its
lowest is found where a longer exposure shows what a shorter one clipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise.camera.colour import linear_from_srgb
from blurnoise_eval.calibration.frames import Floats

Values = NDArray[np.uint8]
VALUES = np.arange(256.0)
# The fit is of the difference to sRGB, which cameras depart from smoothly.
SRGB = np.log(np.maximum(linear_from_srgb(torch.from_numpy(VALUES / 255)).numpy(), 1e-6))
DARKEST, BRIGHTEST = 3, 254
"""Values that do not clip, of pictures that clip at 255 alone."""
# Values over which the curve may bend. With 12, halves of a real bracket two stops apart differed by 0.4 EV: such a
# curve is known but for what repeats every two stops.
_SMOOTH = 30.0
# The curve is a sum of these, as linear light and any gamma are, and of what is smooth.
_SHAPES = np.stack([np.log(np.maximum(VALUES, 0.25) / 255), SRGB])
_ROUNDS = 6  # of weights, after which the curve moves by less than 0.1 values
_HUBER = 1.345  # deviations, 95 % efficient for Gaussian noise (Huber 1964)
_LEAST_DEVIATION = 0.3  # of rounding, in values
_PILED = 4.0  # times the values below it that a value holds where pictures clip
_LEAST_PILED = 1e-3  # of all values
_HIGH = 160  # least value at which pictures may clip
_SURE, _LEAST_SURE = (
    16,
    0.01,
)  # value from which, and share of pixels by which noise and rounding move no offset
_LOW_QUANTILE = 0.005  # of the values of clipped areas
_RANGE = 16  # values below the usual one that clipped areas may have; JPEG files have 10


@dataclass(frozen=True)
class ToneResponse:
    """Logarithm of light (256,) at each value, 0 where pictures clip.

    top: the highest value below the range of clipped areas; clip: their usual value, from top to 255. offsets: for
    each picture, the logarithm of its light over that of its exposure, NaN where hardly a value is above 16.
    residuals: for each, the deviation from the curve in values, RMS with Huber's weights, NaN without a value that
    counts. spread: standard
    deviation of logs by leaving out each picture, relative to the light of the value 128; NaN for three pictures.

    >>> values = np.linspace(20, 240, 999)
    >>> stack = np.rint([255 * (values / 255 * 2**k / 4) ** 0.5 for k in range(3)]).astype(np.uint8)
    >>> bool(abs(fit_response(stack, np.log([1.0, 2.0, 4.0])).offsets).max() < 0.01)
    True
    """

    logs: Floats
    top: int
    clip: float
    offsets: Floats
    residuals: Floats
    spread: Floats

    def values_of(self, logs: Floats) -> Floats:
        """Values, not rounded, of the logarithm of light, of any shape."""
        rising = np.maximum.accumulate(self.logs) + 1e-9 * VALUES
        known, at = self.top + 1, [rising[self.top], 0.0]
        values = np.interp(logs, rising[:known], VALUES[:known])
        return np.where(logs > at[0], np.interp(logs, at, [self.top, self.clip]), values)

    def light_of(self, stack: Values, times: Floats) -> Floats:
        """Logarithm of the light (N,) of pixels, merged from pictures (J, N); NaN where none shows it unclipped."""
        slope = np.clip(np.gradient(self.logs), 1e-3, 1.0)
        weight = np.where((stack >= DARKEST) & (stack <= self.top), 1 / slope[stack] ** 2, 0.0)
        total, sums = weight.sum(0), (weight * (self.logs[stack] - times[:, None])).sum(0)
        light: Floats = np.divide(sums, total, out=np.full(len(total), np.nan), where=total > 0)
        return light


def fit_response(
    stack: Values, times: Floats, clips: tuple[int, float] | None = None, *, spread: bool = True
) -> ToneResponse:
    """The response behind pictures (J, N) of ``times``, logarithms of exposures in rising order.

    clips: top and clip where they are known; None: found by :func:`clipping`. spread: False leaves it NaN, in half
    the time.
    """
    top, clip = clipping(stack) if clips is None else clips
    counts = (stack >= DARKEST) & (stack <= top)
    usable = counts.sum(0) > 1
    stack, counts = stack[:, usable], counts[:, usable]
    weight = np.where(counts, (stack / 255.0) ** 2, 0.0)
    over = _solved(stack, times, weight)
    for _ in range(_ROUNDS):
        left, slope = _left(over, stack, times, weight)
        deviation = _deviation(left / slope[stack], counts)  # in values
        each = np.maximum(1.0, np.abs(left / slope[stack]) / (_HUBER * deviation))
        weight = np.where(counts, 1 / (each * slope[stack] ** 2), 0.0)
        over = _solved(stack, times, weight)
    left, slope = _left(over, stack, times, weight)
    sure = weight * (stack >= _SURE)
    sure[(sure > 0).mean(1) < _LEAST_SURE] = 0.0
    offsets = _shares(-sure * left, sure)
    residuals = np.sqrt(_shares(counts * (left / slope[stack]) ** 2 / each, counts / each))
    deviations = np.full(256, np.nan)
    if spread and len(stack) > 3:
        keep = ~np.eye(len(stack), dtype=bool)
        others = np.array([_solved(stack[some], times[some], weight[some]) for some in keep])
        deviations = np.std(others - others[:, 128:129], axis=0) * np.sqrt(len(stack) - 1)
    return ToneResponse(_from_clip(over + SRGB, top, clip), top, clip, offsets, residuals, deviations)


def clipping(stack: Values) -> tuple[int, float]:
    """The highest value below those of clipped areas, and their usual value; (254, 255.0) where nothing clips.

    stack (J, N): pictures with exposures in rising order. Pixels at the usual value or above it in one picture are
    clipped in the next; the lowest of their values there is where clipped areas begin.

    >>> ramp = np.arange(1, 255, dtype=np.uint8)
    >>> clipping(np.stack([ramp, np.where(ramp > 125, 250, 2 * ramp).astype(np.uint8)]))
    (249, 250.0)
    """
    counts = np.bincount(stack.ravel(), minlength=256)
    clip = _HIGH + int(counts[_HIGH:].argmax())
    if counts[clip] < max(_PILED * counts[clip - 24 : clip - 8].mean(), _LEAST_PILED * stack.size):
        return BRIGHTEST, 255.0
    again = np.concatenate([longer[shorter >= clip] for shorter, longer in pairwise(stack)])
    if not len(again):  # the last picture alone clips
        return min(clip - 1, BRIGHTEST), float(clip)
    lowest = int(np.quantile(again, _LOW_QUANTILE, method="lower"))
    return min(max(lowest, clip - _RANGE) - 1, clip - 1, BRIGHTEST), float(np.median(again))


def _from_clip(logs: Floats, top: int, clip: float) -> Floats:
    """Light relative to that of the value at which pictures clip; beyond top, where none counts, straight in it."""
    slope = (logs[top] - logs[top - 8]) / 8
    logs = np.where(top < VALUES, logs[top] + slope * (VALUES - top), logs)
    relative: Floats = logs - (logs[top] + slope * max(clip - top, 0.0))
    return relative


def _shares(each: Floats, weight: Floats) -> Floats:
    """Sums over pixels relative to those of the weights, for each picture; NaN for one without weight."""
    total = weight.sum(1)
    shares: Floats = np.divide(each.sum(1), total, out=np.full(len(each), np.nan), where=total > 0)
    return shares


def _left(over: Floats, stack: Values, times: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Residuals (J, N) of the logarithm of light, and its slope (256,) over values."""
    logs = over + SRGB
    left = logs[stack] - times[:, None]
    left -= (weight * left).sum(0) / weight.sum(0)
    return left, np.clip(np.gradient(logs), 1e-3, 1.0)


def _deviation(values: Floats, counts: NDArray[np.bool_]) -> float:
    """Robust deviation of the residuals that count, by their median."""
    return max(_LEAST_DEVIATION, 1.4826 * float(np.median(np.abs(values[counts]))))


def _solved(stack: Values, times: Floats, weight: Floats) -> Floats:
    """The difference (256,) of the logarithm of light to that of sRGB, by weighted least squares."""
    terms = np.vstack([np.eye(256), _SHAPES])
    total = np.maximum(weight.sum(0), 1e-12)
    known: Floats = times[:, None] - SRGB[stack]
    known -= (weight * known).sum(0) / total  # eliminates the light of the pixel
    matrix: Floats = np.diag(np.bincount(stack.ravel(), weight.ravel(), 256)).astype(float)
    wanted = np.bincount(stack.ravel(), (weight * known).ravel(), 256)
    for one, other in combinations_with_replacement(range(len(stack)), 2):
        pair = np.bincount(
            256 * stack[one].astype(int) + stack[other], weight[one] * weight[other] / total, 1 << 16
        )
        pair = pair.reshape(256, 256)
        matrix -= pair if one == other else pair + pair.T
    smooth = float(np.trace(matrix)) / 256
    matrix += np.outer(VALUES, VALUES) / 255**2 * smooth  # fixes the arbitrary unit of light
    bend = np.diff(np.eye(256, len(terms)), 2, axis=0)
    normal = terms @ matrix @ terms.T + smooth * (
        _SMOOTH**4 / 256 * bend.T @ bend + 1e-9 * np.eye(len(terms))
    )
    solved: Floats = np.linalg.solve(normal, terms @ wanted) @ terms
    return solved
