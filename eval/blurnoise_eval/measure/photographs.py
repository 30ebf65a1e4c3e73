"""Photographs as scenes: the noise that they bring along, their clipped parts and their JPEG quality.

Domain: luma of pictures of 8 bits, DN. What a photograph holds counts as scene, so its noise is simulated once more.
Noise is the fine part of luma in the flattest squares of a picture; texture there counts, too. JPEG and noise filters
take fine noise first, and what they leave is coarse: nothing tells it from the scene.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise_eval.datasets import PictureSet, sample
from blurnoise_eval.datasets.jpeg import encoding
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.single_picture import expose
from blurnoise_eval.system.urls import Location

SAMPLED = 16
"""Pictures of a set in which noise is measured."""
SQUARE_PX, CELL_PX = 16, 4
FLATTEST_SHARE, FEWEST_SQUARES = 0.05, 8
_DARKEST, _BRIGHTEST = 3, 250  # values that do not clip
_WHITE = 254  # from which on a value of a JPEG may be clipped
_CLIPPED_SHARE = 0.01  # of pixels, from which on it is worth a line
_LEAST_RAISE = 0.01
_KEEPS_FINE = 96
"""JPEG quality from which on fine noise of 1.5 DN is whole; at 90 a third of it is left, and 3/4 of all."""
_ROUNDING_DN2 = 1 / 12
_PATCH_PX = 96
_SATURATED_SHARE = 0.01
_SECOND_DIFFERENCES = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
"""Immerkaer's mask (Computer Vision and Image Understanding 64 (1996) 300): it keeps the variance of white noise, and
of a scene what is no sum of a function of x and one of y of second order."""


@dataclass(frozen=True)
class Photographs:
    """What pictures bring along: medians over those in which it can be measured.

    noise_dn, level_dn: of luma in flat parts, rounding included, and where. noisiest_dn: exceeded by a tenth of the
    pictures. clipped: of each picture, the share of pixels of which a colour is white. jpeg_quality: None where
    none is a JPEG.
    """

    noise_dn: float
    noisiest_dn: float
    level_dn: float
    clipped: tuple[float, ...]
    jpeg_quality: int | None

    @property
    def texts(self) -> list[str]:
        """Noise, JPEG quality and clipped parts, half a line each."""
        more = f" ({self.noisiest_dn:.2g} or more in a tenth)" if self.noisiest_dn > self.noise_dn else ""
        texts = [f"fine noise and texture of {self.noise_dn:.2g} DN in flat parts{more}"]
        if self.jpeg_quality:
            coarse = ", which leaves coarse noise that looks like scene" * (self.jpeg_quality < _KEEPS_FINE)
            texts.append(f"JPEG quality {self.jpeg_quality}{coarse}")
        if worth := [share for share in self.clipped if share >= _CLIPPED_SHARE]:
            many, typical = f"{len(worth)} of {len(self.clipped)} pictures", float(np.median(worth))
            texts.append(
                f"{many} clip, {typical:.0%} of their pixels: grey in darker frames, where a scene may stay white"
            )
        return texts


def photographs(pictures: Sequence[tuple[Location | None, NDArray[np.uint8]]]) -> Photographs | None:
    """What pictures (H, W, 3) bring along, with their files; None where none has flat parts.

    >>> noisy = np.random.default_rng(0).normal(120, 4, (240, 240, 1)).round().astype(np.uint8).repeat(3, 2)
    >>> photographs([(None, noisy)]).texts
    ['fine noise and texture of 4.1 DN in flat parts']
    """
    noise = [known for _, image in pictures if (known := flat_noise(image))]
    if not noise:
        return None
    deviations, levels = np.array(noise).T
    clipped = tuple(float((image >= _WHITE).any(-1).mean()) for _, image in pictures)
    qualities = [encoded.quality for file, _ in pictures if file is not None and (encoded := encoding(file))]
    return Photographs(
        float(np.median(deviations)),
        float(np.quantile(deviations, 0.9)),
        float(np.median(levels)),
        clipped,
        round(float(np.median(qualities))) if qualities else None,
    )


def about_photographs(pictures: PictureSet, camera: Camera, plan: SweepPlan) -> str | None:
    """A line on what the pictures of a sweep bring along, beside the noise of its frames; None for rendered ones, and
    where none has flat parts."""
    folder = pictures.folder
    if folder is None or pictures.kind == "rendered":
        return None
    some = [(folder / picture.name, image) for picture, image in sample(pictures, SAMPLED, light=False)]
    found = photographs(some)
    if found is None:
        return None
    noise, *others = found.texts
    return "; ".join([f"pictures: {noise}{_raised_text(raised(found, camera, plan))}", *others])


def flat_noise(picture: NDArray[np.uint8]) -> tuple[float, float] | None:
    """Deviation and level of luma in the flattest squares of a picture (H, W, 3), DN; None where too few squares do
    not clip in any colour.

    Flat are squares whose cells' means hardly leave a plane. That depends little on noise, which would make the
    smallest deviations of all too small.
    """
    squares = _squares(_luma(picture))
    least, most = (_squares(part) for part in (picture.min(-1), picture.max(-1)))
    inside = (least.min((1, 2)) >= _DARKEST) & (most.max((1, 2)) <= _BRIGHTEST)
    if np.count_nonzero(inside) < FEWEST_SQUARES / FLATTEST_SHARE:
        return None
    cells = SQUARE_PX // CELL_PX
    means = squares[inside].reshape(-1, cells, CELL_PX, cells, CELL_PX).mean((2, 4))
    x = np.arange(cells) - (cells - 1) / 2
    down, across = (
        np.einsum(f"bij,{along}->b", means, x)[:, None, None] / (cells * float(x @ x)) for along in "ij"
    )
    plane = means.mean((1, 2), keepdims=True) + down * x[:, None] + across * x
    unevenness = ((means - plane) ** 2).mean((1, 2))
    flattest = np.argsort(unevenness, kind="stable")[
        : max(FEWEST_SQUARES, round(FLATTEST_SHARE * len(means)))
    ]
    variances = (_squares(_fine(picture))[inside][flattest] ** 2).mean((1, 2))
    return math.sqrt(float(variances.mean())), float(np.median(means[flattest].mean((1, 2))))


def raised(found: Photographs, camera: Camera, plan: SweepPlan) -> dict[float, tuple[float, float]]:
    """By lux: how much more noise simulated frames have, as a share, for that of the pictures, and of the noisiest
    tenth.

    Frames of a grey patch, with and without it, are compared at rest, at the longest exposure that does not saturate.
    """
    patch = np.full((_PATCH_PX, _PATCH_PX, 3), round(found.level_dn), np.uint8)
    drawn = np.random.default_rng(0).normal(size=(_PATCH_PX, _PATCH_PX, 1))
    patches = [patch]
    for noise_dn in (found.noise_dn, found.noisiest_dn):
        own_dn = math.sqrt(max(0.0, noise_dn**2 - _ROUNDING_DN2))
        patches.append((patch + own_dn * drawn).round().clip(0, 255).astype(np.uint8))
    shares = {}
    for lux in plan.values("illuminance_lux"):
        for exposure_s in sorted(plan.values("exposure_s"), reverse=True):
            at = {
                "exposure_s": exposure_s,
                "illuminance_lux": lux,
                "gain_db": (*plan.values("gain_db"), AUTOMATIC)[0],
            }
            conditions: dict[str, Any] = {
                name: "auto" if value == AUTOMATIC else value for name, value in at.items()
            }
            frames = [expose(image, camera, **conditions) for image in patches]
            if (frames[0].saturated or 0.0) < _SATURATED_SHARE:
                own, usual, most = (float(_fine(frame.image).std()) for frame in frames)
                shares[lux] = (max(0.0, usual / own - 1), max(0.0, most / own - 1)) if own else (0.0, 0.0)
                break
    return shares


def _raised_text(shares: Mapping[float, tuple[float, float]]) -> str:
    if not shares:
        return ""
    lux, (usual, most) = max(shares.items(), key=lambda of: of[1])
    if most < _LEAST_RAISE:
        return ", less than 1 % of the noise of simulated frames"
    free = max((at for at, share in shares.items() if share[0] < _LEAST_RAISE), default=0.0)
    darker = f", up to {free:g} lux less than 1 %" if 0 < free < lux else ""
    tenth = f" ({most:.0%})" if most > usual else ""
    return f", simulated once more: frames at {lux:g} lux have {usual:.0%}{tenth} more noise{darker}"


def _luma(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def _squares(plane: NDArray[np.generic]) -> NDArray[np.float64]:
    """(H, W) cut in squares (n, side, side)."""
    rows, columns = (side // SQUARE_PX for side in plane.shape)
    cropped = plane[: rows * SQUARE_PX, : columns * SQUARE_PX]
    squares = cropped.reshape(rows, SQUARE_PX, columns, SQUARE_PX).swapaxes(1, 2)
    return squares.reshape(-1, SQUARE_PX, SQUARE_PX).astype(float)


def _fine(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Second differences of luma, (H, W)."""
    differences = cv2.filter2D(
        _luma(picture), cv2.CV_32F, _SECOND_DIFFERENCES, borderType=cv2.BORDER_REFLECT_101
    )
    return np.asarray(differences)
