"""Noise reduction and sharpening of a camera, from flat frames as it delivers them: developed, by gain.

Domain: pictures of 8 bits of an even, grey surface, two or more at each gain, all of one brightness. The difference
of two frames holds noise alone. Its power by octaves of frequency, of luma and of chroma, is compared with that of
frames of the same brightness that the camera without these steps would deliver; their strengths are those with which
both agree best. A camera file has all else that noise depends on: gain, read noise, colours, tone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from blurnoise.camera import Camera
from blurnoise.camera.isp import NoiseReduction, Sharpening
from blurnoise.picture.steps import Development, active
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise.scene.take import EIGHT_BIT, take_each
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.listing import table_reader, with_points
from blurnoise_eval.calibration.sharpened_edge import sharpening_of
from blurnoise_eval.calibration.to_camera import Known, changed
from blurnoise_eval.datasets import decode, eight_bit
from blurnoise_eval.datasets.exif import exif_exposure
from blurnoise_eval.datasets.jpeg import encoding
from blurnoise_eval.system.files import inside

Picture = NDArray[np.uint8]
OCTAVES = (0.25, 0.125, 0.0625)
"""Borders of the octaves of frequency, cycles/px."""
NOISE_OFF, SPECTRUM_OFF = 0.15, 0.25
"""Relative errors of noise, and of its amplitude in an octave, above which a gain is doubtful."""
ROUNDING_DN = 12**-0.5
MOST_PX, BLOCK_PX = 512, 32
_FIT_PX = 160  # side of the frames that are simulated
_EDGE = "edge"  # name of a picture of a slanted edge, at the lowest gain
_LIST, _SUFFIXES = "frames.csv", (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_DARKEST, _BRIGHTEST = 16.0, 235.0  # mean values between which noise does not clip
_ALIKE = 0.05  # relative difference of the brightness of frames of one gain
_SEED = 1
_SHARP_COSTS = 0.01  # so that noise which both explain is that of the filter alone
_STARTS = (0.4, 0.4, 0.75, 0.25, 0.0), (0.2, 0.2, 0.9, 0.5, 0.3)
"""Sigmas by difference of luma and of chroma, in 8 times their noise, strength, sigma by distance in 6 px, sharpening
in 2: so that the steps of a search are alike."""
_OPTIONS = {"xatol": 0.01, "fatol": 1e-3, "maxfev": 120}


class Noise(NamedTuple):
    """Of luma and of chroma: deviation, DN, and power by octave, fine to coarse, (2, 4), DN squared per pixel."""

    deviation_dn: Floats
    power: Floats


@dataclass(frozen=True)
class AtGain:
    """The steps at a gain. taken, simulated: noise of the frames and of the camera with these steps."""

    gain_db: float
    noise_reduction: NoiseReduction
    sharpening: Sharpening
    taken: Noise
    simulated: Noise

    @property
    def noise_off(self) -> float:
        """The larger relative error of the noise of luma and of chroma, beside rounding."""
        simulated, taken = (
            np.hypot(noise.deviation_dn, ROUNDING_DN) for noise in (self.simulated, self.taken)
        )
        return float(np.abs(simulated / taken - 1).max())

    @property
    def spectrum_off(self) -> float:
        """The largest relative error of the amplitude in an octave, beside rounding."""
        simulated, taken = (np.sqrt(noise.power + ROUNDING_DN**2) for noise in (self.simulated, self.taken))
        return float(np.abs(simulated / taken - 1).max())

    @property
    def text(self) -> str:
        """'12 dB: luma 2.1 DN (simulated 2.2), chroma 1.4 DN (1.3), octaves within 9 %'."""
        (luma, chroma), (own_luma, own_chroma) = self.taken.deviation_dn, self.simulated.deviation_dn
        noise = f"luma {luma:.2g} DN (simulated {own_luma:.2g}), chroma {chroma:.2g} DN ({own_chroma:.2g})"
        return f"{self.gain_db:g} dB: {noise}, octaves within {self.spectrum_off:.0%}"


@dataclass(frozen=True)
class Developed:
    """Steps of development that were measured. known: fields of a camera; doubts: a line each."""

    gains: tuple[AtGain, ...]
    known: Known
    doubts: tuple[str, ...]


def measure_developed(folder: Path, camera: Camera) -> Developed:
    """Fit noise reduction and sharpening of ``camera`` to the developed flat frames of a folder.

    Frames and their gains come from frames.csv (file, gain_db) or from the ISO in EXIF, whose lowest is then 0 dB.
    Raises ``ValueError`` for missing or wrong data, ``OSError`` as reading does.
    """
    groups, note = _groups(folder)
    plain = camera.with_figures(noise_reduction=(), sharpening=(), local_tone=None, jpeg_quality=None)
    encoded = {encoding(path) for paths in groups.values() for path in paths}
    several = f"{folder}: frames of several encodings; must all be of one format and JPEG quality"
    refuse(len(encoded) > 1, several)
    saved, source = encoded.pop(), f"measured: headers of the frames in {folder.name}"
    known: Known = {"jpeg_quality": (saved.quality if saved else None, source)}
    if saved and saved.subsampling:
        known["jpeg_subsampling"] = (saved.subsampling, source)
    steps = changed(camera.with_figures(noise_reduction=(), sharpening=()), known)
    edge = next(iter(sorted(folder.glob(f"{_EDGE}.*"))), None)
    by_edge = _sharpening_of(edge, plain, steps) if edge else None
    gains = tuple(
        _at_gain(folder, gain_db, paths, plain, steps, by_edge) for gain_db, paths in sorted(groups.items())
    )
    count = sum(map(len, groups.values()))
    source = f"measured: noise of {count} developed flat frames in {folder.name}{note}; assumed: "
    known["noise_reduction"] = (tuple(at.noise_reduction for at in gains), f"{source}a bilateral filter")
    sharp = any(at.sharpening.strength for at in gains)
    if by_edge:
        source = f"measured: the edge {edge.name if edge else ''} in {folder.name}; assumed: "
    rows = (by_edge,) if by_edge else tuple(at.sharpening for at in gains)
    known["sharpening"] = (rows if sharp else (), f"{source}an unsharp mask")
    doubts = [
        f"{at.text}; another filter, or another camera than {camera.name}?"
        for at in gains
        if at.noise_off > NOISE_OFF or at.spectrum_off > SPECTRUM_OFF
    ]
    return Developed(gains, known, tuple(doubts))


def noise_of(pictures: Sequence[Picture]) -> Noise:
    """Noise of pictures (H, W, 3) of one level, by the differences of each two.

    >>> drawn = np.random.default_rng(0).normal(128, 4, (2, 128, 128, 1)).round().astype(np.uint8).repeat(3, 3)
    >>> noise = noise_of(drawn)  # white, and without chroma
    >>> noise.deviation_dn.round(1).tolist(), noise.power[0].round(-1).tolist()
    ([4.0, 0.0], [20.0, 20.0, 20.0, 20.0])
    """
    planes = [cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2YCrCb) for picture in pictures]
    pairs = zip(planes[::2], planes[1::2], strict=False)
    noise = np.stack([(one - other) / math.sqrt(2) for one, other in pairs]).astype(float)
    noise -= noise.mean((1, 2), keepdims=True)
    variance = (noise**2).mean((0, 1, 2))
    rows, columns = (side // BLOCK_PX for side in noise.shape[1:3])
    blocks = noise[:, : rows * BLOCK_PX, : columns * BLOCK_PX]
    blocks = blocks.reshape(-1, rows, BLOCK_PX, columns, BLOCK_PX, 3).swapaxes(2, 3)
    window = np.hanning(BLOCK_PX + 1)[:-1]
    window = np.outer(window, window)[..., None]
    power = (np.abs(np.fft.fft2(blocks * window, axes=(3, 4))) ** 2).mean((0, 1, 2)) / (window**2).sum()
    frequency = np.fft.fftfreq(BLOCK_PX)
    octave = np.searchsorted(-np.array(OCTAVES), -np.hypot(frequency[:, None], frequency), side="right")
    octave[0, 0] = -1
    by_octave = np.stack([power[octave == number].mean(0) for number in range(len(OCTAVES) + 1)], 1)
    both = [[0], [1, 2]]  # luma; the two planes of chroma
    return Noise(
        np.sqrt([variance[of].mean() for of in both]), np.stack([by_octave[of].mean(0) for of in both])
    )


def _sharpening_of(edge: Path, plain: Camera, camera: Camera) -> Sharpening:
    try:
        return sharpening_of(eight_bit(decode(edge)), camera, 0.0, lambda level: _lux_of(plain, 0.0, level))
    except ValueError as error:
        raise ValueError(f"{edge}: {error}") from None


def _at_gain(
    folder: Path,
    gain_db: float,
    paths: Sequence[Path],
    plain: Camera,
    camera: Camera,
    by_edge: Sharpening | None = None,
) -> AtGain:
    """plain: the camera without steps on numbers of 8 bits; camera: with those that are known. by_edge: or None."""
    pictures = [_central(path) for path in paths]
    means = np.array([float(_luma(picture).mean()) for picture in pictures])
    at = f"{folder}: frames at {gain_db:g} dB"
    refuse(len({picture.shape for picture in pictures}) > 1, f"{at}: must all have one size")
    uneven = f"{at} have mean values from {means.min():.0f} to {means.max():.0f}; must be of one light and exposure"
    refuse(np.ptp(means) > _ALIKE * means.mean(), uneven)
    level = float(means.mean())
    refuse(not _DARKEST < level < _BRIGHTEST, f"{at} have the mean value {level:.0f}; must be from 16 to 235")
    taken = noise_of(pictures)
    refuse(
        not taken.deviation_dn[0] > 0, f"{at} are all alike; must be two exposures of a surface, not copies"
    )
    own = _frames(plain, gain_db, _lux_of(plain, gain_db, level))

    unit = np.array([*(8 * np.hypot(noise_of(own).deviation_dn, ROUNDING_DN)), 1.0, 6.0, 2.0])
    most = np.array([255.0, 255.0, 1.0, 6.0, 10.0])
    least = np.array([0.0, 0.0, 0.0, 0.5, 0.0])

    def steps_of(scaled: Floats) -> tuple[NoiseReduction, Sharpening]:
        *reduction, sharp = np.clip(np.round(scaled * unit, 2), least, most).tolist()
        return NoiseReduction(gain_db, *reduction), by_edge or Sharpening(gain_db, sharp)

    def off(scaled: Floats) -> float:
        steps = steps_of(scaled)
        noise = noise_of(_coded(own, camera, *steps))
        apart = np.log((noise.power + ROUNDING_DN**2) / (taken.power + ROUNDING_DN**2))
        return float((apart**2).sum() + _SHARP_COSTS * steps[1].strength)

    bounds: Any = list(zip(least / unit, most / unit, strict=True))

    def nearest(start: Floats) -> Any:
        return minimize(off, start, method="Nelder-Mead", bounds=bounds, options=_OPTIONS)

    # From the better of two a second time, as the simplex of a search may have become flat.
    first = min((nearest(np.array(start)) for start in _STARTS), key=lambda found: float(found.fun))
    steps = steps_of(nearest(first.x).x)
    return AtGain(gain_db, *steps, taken, noise_of(_coded(own, camera, *steps)))


def _frames(camera: Camera, gain_db: float, lux: float, count: int = 4, side: int = _FIT_PX) -> list[Picture]:
    """Frames of a grey surface, (side, side, 3)."""
    scene = Scene(torch.full((1, 1, side, side), 0.5))
    exposures = [Exposure(camera, 0.01, lux, gain_db=gain_db, seed=_SEED + n) for n in range(count)]
    found = [frames.images()[0] for frames in take_each(scene, exposures, EIGHT_BIT)]
    return [image if image.shape[-1] == 3 else np.repeat(image, 3, -1) for image in found]


def _lux_of(camera: Camera, gain_db: float, level: float) -> float:
    """The light in which luma of a frame has a mean, by bisection."""
    low, high = -8.0, 8.0
    for _ in range(24):
        middle = (low + high) / 2
        found = float(_luma(_frames(camera, gain_db, 10**middle, 1, 48)[0]).mean())
        low, high = (middle, high) if found < level else (low, middle)
    return float(10**low)


def _coded(
    pictures: Sequence[Picture], camera: Camera, reduction: NoiseReduction, sharpening: Sharpening
) -> list[Picture]:
    """Pictures after the steps that work on numbers of 8 bits."""
    at = Development(camera.with_figures(noise_reduction=(reduction,), sharpening=(sharpening,)))
    stack = torch.from_numpy(np.stack(pictures).transpose(0, 3, 1, 2).copy())
    for step in active(at.camera):
        stack = step.apply(stack, at) if step.coded else stack
    return list(stack.numpy().transpose(0, 2, 3, 1))


def _groups(folder: Path) -> tuple[dict[float, list[Path]], str]:
    """Frames by gain, and a note on how it is known."""
    refuse(not folder.is_dir(), f"developed = {str(folder)!r}: must be a folder of pictures")
    listed = list(_listed(folder / _LIST)) if (folder / _LIST).is_file() else []
    note = ""
    if not (folder / _LIST).is_file():
        pictures = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in _SUFFIXES and p.stem != _EDGE]
        isos = {path: exif_exposure(path).iso for path in pictures}
        missing = [path.name for path, iso in isos.items() if not iso > 0]
        must = f"add it to EXIF or to {_LIST} (file, gain_db)"
        refuse(missing, f"{folder / (missing or [''])[0]}: ISO is missing; {must}")
        lowest = min(isos.values(), default=1.0)
        listed = [(path, round(20 * math.log10(iso / lowest), 2)) for path, iso in isos.items()]
        note = f", ISO {lowest:g} taken for 0 dB"
    groups: dict[float, list[Path]] = {}
    for path, gain_db in listed:
        groups.setdefault(gain_db, []).append(path)
    refuse(not groups, f"{folder}: contains no pictures ({' '.join(_SUFFIXES)})")
    for gain_db, paths in groups.items():
        refuse(len(paths) < 2, f"{folder}: {len(paths)} frame at {gain_db:g} dB; must be two or more")
    return groups, note


def _listed(source: Path) -> Iterator[tuple[Path, float]]:
    reader = table_reader(source)
    names = [name.strip().lower() for name in next(reader, [])]
    try:
        for cells in filter(any, reader):
            row = dict(zip(names, with_points(cells, reader), strict=False))
            gain_db = float(row["gain_db"])
            if not 0 <= gain_db <= 100:
                raise ValueError
            yield source.parent / inside(row["file"]), gain_db
    except (KeyError, ValueError):
        raise ValueError(f"{source}: must have the columns file and gain_db (0 to 100)") from None


def _central(path: Path) -> Picture:
    """The middle of a picture, (H, W, 3), on the grid of JPEG's blocks."""
    picture = eight_bit(decode(path))
    picture = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, -1)
    height, width = picture.shape[:2]
    refuse(min(height, width) < 2 * BLOCK_PX, f"{path}: must be at least {2 * BLOCK_PX} px per side")
    top, left = (max(0, side - MOST_PX) // 32 * 16 for side in (height, width))
    return picture[top : top + MOST_PX, left : left + MOST_PX]


def _luma(picture: Picture) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY), np.uint8)
