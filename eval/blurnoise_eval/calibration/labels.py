"""Labels of flat levels, their exposure and light, checked against the signals of all levels.

A label is wrong where the signal over the light differs grossly from that of the other levels, while those agree.
After a tone curve no levels agree, so none is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.formats import Plane
from blurnoise_eval.calibration.listing import FrameFile

Floats = NDArray[np.float64]
Light = Literal["photons", "lux s", "s"]
GROSSLY = 1.5  # factor of the signal, far beyond that of any lamp or bend
AGREED = 0.05  # relative difference from the median
MOST_WRONG = 0.2  # share of the levels
_SURELY = 5.0  # standard deviations
PILED = 5e-3  # share of pixels with the largest number above which a level clips there
_DIM = 0.05  # of the brightest signal, as in EMVA 1288's linearity


def light_of(taken: Sequence[FrameFile]) -> tuple[Floats, Light]:
    """The light of each level and its unit: photons, else lux times exposure, else the exposure.

    >>> from pathlib import Path
    >>> levels = [FrameFile(file=Path("a.png"), kind="flat", exposure_s=time_s) for time_s in (0.1, 0.2)]
    >>> light_of(levels)
    (array([0.1, 0.2]), 's')
    """
    exposure_s, photons, lux = (
        np.array([*map(attrgetter(name), taken)], float)
        for name in ("exposure_s", "photons_per_px", "illuminance_lux")
    )
    if not np.isnan(photons).any():
        return photons, "photons"
    if len(np.unique(lux)) > 1 and not np.isnan(lux).any():
        return lux * exposure_s, "lux s"
    return exposure_s, "s"


class FrameSeen(NamedTuple):
    """What a frame shows: its mean, its largest number and the share of the pixels that have it."""

    mean_dn: float
    highest_dn: int
    share: float

    @classmethod
    def of(cls, plane: Plane) -> FrameSeen:
        """Of a frame.

        >>> FrameSeen.of(np.array([[1, 3], [3, 1]], np.uint8))
        FrameSeen(mean_dn=2.0, highest_dn=3, share=0.5)
        """
        highest = plane.max()
        return cls(float(plane.mean()), int(highest), float((plane == highest).mean()))


def contradicted(
    dark: Sequence[Sequence[FrameFile]],
    flat: Sequence[Sequence[FrameFile]],
    seen: Mapping[FrameFile, FrameSeen],
) -> dict[int, str]:
    """The flat levels whose labels are wrong, by index, each with a note; none if they are more than a fifth.

    dark, flat: the frames of each level of one gain.

    >>> from pathlib import Path
    >>> times_s, means_dn = (0.1, 0.2, 0.3, 0.4, 0.005), (20.0, 30.0, 40.0, 50.0, 35.0)
    >>> flat = [[FrameFile(file=Path("a.png"), kind="flat", exposure_s=time_s)] for time_s in times_s]
    >>> seen = {level[0]: FrameSeen(mean, 99, 0.0) for level, mean in zip(flat, means_dn)}
    >>> dark = [[FrameFile(file=Path("b.png"), kind="dark", exposure_s=0.1)]]
    >>> contradicted(dark, flat, seen | {dark[0][0]: FrameSeen(10.0, 12, 0.0)})
    {4: 'flat 5 ms: its signal fits 250 ms by the other levels; left out'}
    """
    taken = [level[0] for level in flat]
    light, _ = light_of(taken)
    signal, error_dn = _signal(dark, flat, seen)
    top_dn = max(seen[frame].highest_dn for level in flat for frame in level)
    clipped = np.array([any(seen[x].highest_dn == top_dn and seen[x].share > PILED for x in y) for y in flat])
    sure = (light > 0) & (signal > np.maximum(_SURELY * error_dn, _DIM * signal.max())) & ~clipped
    if len({level.wavelength_nm for level in taken}) > 1 or not sure.any():
        return {}  # of different wavelengths, the signals of the same light differ
    expected = light * np.median(signal[sure] / light[sure])
    off = np.abs(signal - expected)
    # a clipped level has less signal than its light, as it should
    gross = ((signal * GROSSLY < expected) & ~clipped) | (signal > GROSSLY * expected)
    # far below the dark frames, those are wrong rather than the level
    wrong = gross & (off > _SURELY * error_dn) & (signal > -_SURELY * error_dn)
    agree = off[sure] <= AGREED * expected[sure]
    if wrong.mean() > MOST_WRONG or agree.mean() < 1 - MOST_WRONG:
        return {}
    return {index: _note(taken, signal, ~wrong, index) for index in np.flatnonzero(wrong).tolist()}


def _signal(
    dark: Sequence[Sequence[FrameFile]],
    flat: Sequence[Sequence[FrameFile]],
    seen: Mapping[FrameFile, FrameSeen],
) -> tuple[Floats, float]:
    """Means of flat levels above those of the dark ones (N,), and the scatter of the dark frames."""
    means = [np.array([seen[frame].mean_dn for frame in level]) for level in (*dark, *flat)]
    level_dn = np.array([of.mean() for of in means])
    exposure_s = np.array([level[0].exposure_s for level in (*dark, *flat)])
    count = len(dark)
    base = np.interp(exposure_s[count:], exposure_s[:count], level_dn[:count])
    scatter = math.sqrt(sum(float(of.var()) for of in means[:count]) / count)
    return level_dn[count:] - base, scatter


def _note(taken: Sequence[FrameFile], signal: Floats, right: NDArray[np.bool_], index: int) -> str:
    """What the label would be by the levels that are right."""
    order = np.flatnonzero(right)[np.argsort(signal[right])]
    fits = []
    for name, unit, factor in (
        ("exposure_s", "ms", 1e3),
        ("photons_per_px", "photons/px", 1.0),
        ("illuminance_lux", "lx", 1.0),
    ):
        values = factor * np.array([*map(attrgetter(name), taken)], float)
        if not np.isnan(values).any() and len(np.unique(values)) > 1:
            fits.append(f"{np.interp(signal[index], signal[order], values[order]):.3g} {unit}")
    return f"{taken[index].level_name}: its signal fits {', '.join(fits)} by the other levels; left out"
