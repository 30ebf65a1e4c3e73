"""Exposure with which a photograph was taken: its time, ISO and f-number, and the light that its values stand for.

By ISO 12232:2019 the value 118 of 255 (18 % of white in sRGB) has a focal-plane exposure of H = 10 / S lx s at the
standard output sensitivity S. A recommended exposure index (REI) names the same H, as the maker's mean; which of the
two a file's ISO is, its tag SensitivityType says, and the light follows from both alike. A surface of luminance L has
H = 0.65 L T / N^2 there (the standard's usual lens), and white reflects pi L lux. Cameras keep to this within a third
of a stop or so, and say nothing of exposure compensation, which is in T and N already.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Self

import torch

from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone, untoned
from blurnoise.camera.radiometry import photoelectrons
from blurnoise_eval.datasets.exif import exif_exposure

_VALUE, _LX_S, _LENS = 118 / 255, 10.0, 0.65
_MUST = "must be time, ISO and f-number, such as 1/30,200,f2.8"
_LIMITS = {"exposure_s": (1e-6, 1e5), "iso": (1.0, 1e7), "f_number": (0.5, 1000.0)}
MOST_READ = 1000
"""Photographs of a set whose EXIF is read."""


@dataclass(frozen=True)
class Taken:
    """An exposure: time in s, ISO, f-number; kind: what the ISO is, as EXIF names it.

    Raises ``ValueError`` for values that no camera has.

    >>> Taken.parse("1/30,200,f2.8").text
    '1/30 s, ISO 200, f/2.8'
    """

    exposure_s: float
    iso: float
    f_number: float
    kind: str = ""

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} = {value:g}: must be {low:g} to {high:g}, as of cameras")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From "1/30,200,f2.8": time in s, ISO, f-number. Raises ``ValueError``."""
        try:
            time, iso, f_number = (part.strip() for part in text.split(","))
            f_number = f_number.lower().removeprefix("f").removeprefix("/")
            numbers = float(Fraction(time)), float(iso), float(f_number)
        except (ValueError, ZeroDivisionError, OverflowError):
            raise ValueError(f"taken = {text!r}: {_MUST}") from None
        try:
            return cls(*numbers)
        except ValueError as error:
            raise ValueError(f"taken = {text!r}: {error}") from None

    @classmethod
    def of_file(cls, path: Path) -> Self | None:
        """From a picture's EXIF; None where it lacks one of the three, or is no picture that Pillow reads."""
        with suppress(OSError, ValueError, SyntaxError):
            return cls(*exif_exposure(path))
        return None

    @staticmethod
    def missing(path: Path) -> str:
        """What a photograph's EXIF lacks, if it has a part of its exposure: "its EXIF lacks the f-number"; or ""."""
        with suppress(OSError, ValueError, SyntaxError):
            exif = exif_exposure(path)
            names = {"exposure time": exif.exposure_s, "ISO": exif.iso, "f-number": exif.f_number}
            lacks = [f"the {name}" for name, value in names.items() if not 0 < value < math.inf]
            return f"its EXIF lacks {' and '.join(lacks)}" if 0 < len(lacks) < len(names) else ""
        return ""

    def lux(self, tone: PictureTone) -> float:
        """Illuminance in which the photograph's white was, for pictures coded by ``tone``.

        Linear pictures count as srgb: the standard's value is of a coded picture.

        >>> round(Taken(1 / 30, 100, 2.8).lux("srgb"))
        627
        """
        coded: PictureTone = "srgb" if tone == "linear" else tone
        light = float(untoned(torch.tensor([_VALUE], dtype=torch.float64), coded)[0])
        white_lx_s = _LX_S / self.iso / light
        return math.pi * white_lx_s * self.f_number**2 / (_LENS * self.exposure_s)

    def camera(self, camera: Camera, lux: float) -> tuple[Camera, float]:
        """``camera`` in the place of the one that took the photograph, and its gain in dB: of its f-number, and as
        sensitive, so that white in ``lux`` fills the range at the photograph's own time.

        Where the camera is the more sensitive one without gain, its lens passes less.

        >>> camera, gain_db = Taken(1 / 30, 1600, 2.8).camera(Camera.preset("imx250c"), 39.0)
        >>> camera.lens.f_number, round(gain_db, 1)
        (2.8, 21.3)
        """
        sources = {**camera.sources, "f_number": "that of the photograph"}
        camera = camera.with_figures(f_number=self.f_number, sources=sources)
        share = photoelectrons(camera, lux, self.exposure_s) / camera.sensor.saturation_e
        if share > 1:
            sources |= {"transmission": "fitted to the photograph's ISO"}
            camera = camera.with_figures(transmission=camera.lens.transmission / share, sources=sources)
        gain_db = max(0.0, -20 * math.log10(share))
        if gain_db > camera.sensor.gain_max_db:
            sources |= {"gain_max_db": "of the photograph's ISO"}
            camera = camera.with_figures(gain_max_db=gain_db, sources=sources)
        return camera, gain_db

    @property
    def text(self) -> str:
        """In words."""
        time = f"{self.exposure_s:.3g}" if self.exposure_s >= 0.3 else f"1/{1 / self.exposure_s:.4g}"
        return f"{time} s, ISO {self.iso:g}{f' ({self.kind})' if self.kind else ''}, f/{self.f_number:g}"


def exif_text(files: Iterable[Path], tone: PictureTone) -> str:
    """How many photographs have their exposure in EXIF, and in how many lux these were taken.

    >>> exif_text([], "srgb")
    'none of 0 photographs'
    """
    every = list(files)[:MOST_READ]
    lux = sorted(taken.lux(tone) for taken in map(Taken.of_file, every) if taken is not None)
    if not lux:
        return f"none of {len(every)} photographs"
    return (
        f"{len(lux)} of {len(every)} photographs, taken in {lux[0]:.2g} to {lux[-1]:.2g} lux "
        f"(median {lux[len(lux) // 2]:.2g})"
    )
