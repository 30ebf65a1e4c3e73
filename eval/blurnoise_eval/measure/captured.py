"""Captured charts without edges: the response of a Siemens star, veiling glare, and the flicker of a lamp in a video.

Domain: linear pictures; regions are (left, top, width, height), px.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from blurnoise.metrics import flicker
from blurnoise.metrics.patches import veiling_glare
from blurnoise.metrics.sharpness import star_response
from blurnoise.metrics.values import CLIPPED_SHARE, Estimate, Roi, cut
from blurnoise_eval.datasets import Image, decode
from blurnoise_eval.datasets.folder import pictures_below
from blurnoise_eval.measure.charts import CLIPPED, estimates_of
from blurnoise_eval.measure.linear import LinearPicture
from blurnoise_eval.system.tables import finite

Z = 1.96  # standard errors of a 95 % interval
TRAP, FIELD, LAMP, SCENE = "light trap", "white field", "lamp", "scene"


@dataclass(frozen=True)
class Captured:
    """What a chart or a video shows. numbers: by their titles; rows: the curve, or the series, behind them."""

    numbers: dict[str, Estimate]
    rows: list[dict[str, Any]]

    def document(self) -> dict[str, Any]:
        """Plain values for a file, None for what is missing.

        >>> Captured({"veiling glare": Estimate(0.5)}, []).document()["metrics"]
        {'veiling glare': {'value': 0.5, 'low': None, 'high': None, 'flags': []}}
        """
        numbers = {
            title: {end: finite(getattr(number, end)) for end in ("value", "low", "high")}
            | {"flags": sorted(number.flags)}
            for title, number in self.numbers.items()
        }
        return {"metrics": numbers, "rows": self.rows}


def star(picture: LinearPicture, rois: Sequence[Roi]) -> Captured:
    """s-SFR of the star in a region, or in the middle of the picture. Raises ``ValueError``.

    >>> from blurnoise import charts
    >>> seen = star(LinearPicture(charts.siemens_star(200)[0].double(), full_scale=1.0), [])
    >>> round(seen.numbers["MTF50 of the star, cycles/px"].value, 1)
    0.6
    """
    if len(rois) > 1:
        raise ValueError(f"roi: {len(rois)} regions; must be one, that of the star")
    region = _region(picture, rois[0]) if rois else picture
    found = star_response(torch.from_numpy(region.grey))
    ends = [(found.power + sign * Z * found.error).clamp_min(0).sqrt().tolist() for sign in (0, -1, 1)]
    names = "frequency_cycles_px", "sfr", "low", "high"
    rows = [dict(zip(names, row, strict=True)) for row in zip(found.frequency.tolist(), *ends, strict=True)]
    clipped = Estimate(math.nan, flags=frozenset({CLIPPED}))
    return Captured({"MTF50 of the star, cycles/px": clipped if _clipped(region) else found.mtf50}, rows)


def glare(picture: LinearPicture, rois: Sequence[Roi]) -> Captured:
    """Veiling glare index of a light trap, the first region, before a white field, the second. Raises ``ValueError``.

    >>> scene = torch.full((1, 20, 40), 0.8, dtype=torch.float64)
    >>> scene[:, :, :20] = 0.02
    >>> regions = [(0, 0, 20, 20), (20, 0, 20, 20)]
    >>> round(glare(LinearPicture(scene, full_scale=1.0), regions).numbers["veiling glare"].value, 3)
    0.025
    """
    if len(rois) != 2:
        raise ValueError(f"roi: {len(rois)} regions; must be two, the light trap and the white field")
    trap, field = (_region(picture, roi) for roi in rois)
    index = veiling_glare(*(torch.from_numpy(region.grey)[None] for region in (trap, field)))
    (number,) = estimates_of(
        replace(index, flags={**index.flags, CLIPPED: torch.tensor([_clipped(field)])}), {CLIPPED}
    )
    means = {TRAP: float(trap.grey.mean()), FIELD: float(field.grey.mean())}
    return Captured(
        {"veiling glare": number}, [{"region": name, "mean": mean} for name, mean in means.items()]
    )


def flickering(source: Path, linear: Callable[[Image], LinearPicture], rois: Sequence[Roi]) -> Captured:
    """Flicker indices of the lamp in a region of a video, or of the frames in a folder, by name.

    A second region shows the scene without the lamp; the detection index needs it. Raises ``ValueError``, also for
    a video that cannot be read.
    """
    if len(rois) not in (1, 2):
        must = "must be one, the lamp, or two, the lamp and the scene without it"
        raise ValueError(f"roi: {len(rois)} regions; {must}")
    rows: list[dict[str, float]] = []
    clipped = False
    for number, frame in enumerate(_frames(source), start=1):
        picture = linear(frame)
        regions = [_region(picture, roi) for roi in rois]
        means = [float(region.grey.mean()) for region in regions]
        rows.append({"frame": number, **dict(zip((LAMP, SCENE), means, strict=False))})
        clipped |= _clipped(regions[0])
    if len(rows) < 2:
        raise ValueError(f"image = {str(source)!r}: must be a video, or a folder, of two frames or more")
    means_of_lamp = torch.tensor([[row[LAMP] for row in rows]], dtype=torch.float64)
    found = {
        "flicker modulation index": flicker.modulation_index(means_of_lamp),
        "modulation mitigation probability": flicker.mitigation_probability(means_of_lamp),
    }
    if len(rois) == 2:
        off = float(np.mean([row[SCENE] for row in rows]))
        found["flicker detection index"] = flicker.detection_index(means_of_lamp, off=off)
    doubt = {CLIPPED: torch.tensor([clipped])}
    numbers = {
        title: estimates_of(replace(index, flags={**index.flags, **doubt}), {"not_finite"})[0]
        for title, index in found.items()
    }
    return Captured(numbers, rows)


def _frames(source: Path) -> Iterator[Image]:
    if source.is_dir():
        yield from (decode(source / name) for name in pictures_below(source)[0])
        return
    video = cv2.VideoCapture(str(source))
    while (read := video.read())[0]:
        yield np.ascontiguousarray(read[1][..., ::-1])


def _region(picture: LinearPicture, roi: Roi) -> LinearPicture:
    return replace(picture, picture=cut(picture.picture, roi))


def _clipped(region: LinearPicture) -> bool:
    return float((region.picture >= region.full_scale).any(0).double().mean()) > CLIPPED_SHARE
