"""Items of charts: MTF50, SNR, information capacity and NEQ over exposure and speed (Figures 12 to 19).

Metrics are of the camera's linear numbers, before any coding, so both chains have the same. Numbers are withheld once
the chart clips; the paper reads on there, and sees MTF50 and SNR rise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from statistics import median
from typing import Any

import torch
from scipy.optimize import brentq

from blurnoise.blur import convolution
from blurnoise.metrics.estimate import Estimate
from blurnoise.optics import transfer
from blurnoise.optics.camera import Camera
from blurnoise_eval.paper.item import Check, Figure, Found, Line, all_near
from blurnoise_eval.paper.measurement import CAMERA, Charts, Measurements, NotRun, Saturation
from blurnoise_eval.quality.measure import TILT_DEG

SPEEDS = (0.0, 150.0, 200.0, 500.0, 1000.0)
OVER_EXPOSURE = Charts(50.0, (2, 5, 10, 15, 18, 21, 24, 27, 30, 45), SPEEDS)
OVER_SPEED = Charts(20.0, (30,), (0.0, 50.0, 100.0, 150.0, 200.0, 350.0, 500.0))
AT_30_MS = Charts(50.0, (30,), SPEEDS)
CLIPPING = Saturation((20.0, 50.0, 100.0, 200.0))
FLAT, CLOSED_FORM, EVEN = 0.01, 0.01, 0.02
"""Shares by which MTF50 may vary at rest, miss the closed form, and patch SNR vary over speed."""
SPREAD_DB, INVERSE = 0.5, 0.02
PEAK_MS = (18.0, 30.0)
_CLIPS_MS = 20.0
"""From here on the paper's lines at 50 lux rise: its chart clips."""
_EXPOSURE = "Exposure / ms"
_SPEED = "Speed / px/s"


def mtf50_over_exposure(measured: Measurements) -> Found:
    """Flat at rest until the chart clips, and lower with speed."""
    numbers = measured[OVER_EXPOSURE]
    rest, told = _line(numbers, "mtf50_x", 0.0), _told(numbers, "mtf50_x", 0.0)
    middle = median(each.value for each in told.values())
    flat = all_near(told.values(), [middle] * len(told), FLAT)
    clipped = [ms for ms, each in rest.items() if not each.told and ms > _CLIPS_MS]
    from_first = bool(clipped) and [ms for ms in rest if ms >= clipped[0]] == clipped
    last = max((ms for ms in told if ms <= 21), default=min(told))
    at_20 = [_line(numbers, "mtf50_x", speed)[last].value for speed in SPEEDS]
    falls = all(after < before for before, after in pairwise(at_20))
    return Found(
        (
            Check(
                "MTF50 at rest",
                "flat to 20 ms",
                f"{middle:.3f} cycles/px, {_spread(each.value for each in told.values()):.1%} from end to end, "
                f"to {max(told):g} ms",
                f"within {FLAT:.0%} of the median, or it within the 95 % interval of all together",
                flat and max(told) >= _CLIPS_MS,
            ),
            Check(
                "MTF50 beyond",
                "rises: an artefact of clipping",
                f"withheld from {clipped[0]:g} ms on" if clipped else "told throughout",
                "withheld once the chart clips",
                from_first,
            ),
            Check(
                f"MTF50 at {last:g} ms and DX {_listed(SPEEDS)}",
                "falls with DX",
                _listed(at_20, ".3f"),
                "falls",
                falls,
            ),
        ),
        (_over_exposure(numbers, "mtf50_x", "MTF50 over exposure, 50 lux", "MTF50 / cycles/px"),),
    )


def mtf50_over_speed(measured: Measurements) -> Found:
    """As the closed form has it, in light in which nothing clips."""
    numbers = measured[OVER_SPEED]
    speeds = OVER_SPEED.speeds_px_s
    found = {speed: numbers["mtf50_x", 30.0, speed] for speed in speeds}
    closed = {speed: mtf50(30e-3 * speed) for speed in speeds}
    told = [speed for speed in speeds if found[speed].told]
    off = {speed: abs(found[speed].value / closed[speed] - 1) for speed in told}
    worst = max(off.values(), default=math.inf)
    near = all_near([found[v] for v in told], [closed[v] for v in told], CLOSED_FORM)
    falls = all(found[b].value < found[a].value for a, b in pairwise(told))
    text = ", ".join(f"{found[speed].value:.4f} ({closed[speed]:.4f}) at {speed:g}" for speed in told)
    clipped = all(not measured[AT_30_MS]["mtf50_x", 30.0, speed].told for speed in SPEEDS)
    return Found(
        (
            Check("MTF50 over DX at 20 lux", "falls", text, "falls", falls and len(told) > 1),
            Check(
                "the same beside the closed form (in brackets)",
                "pixel x disc x motion",
                f"{worst:.2%} off at most, told at {len(told)} of {len(speeds)} speeds",
                f"within {CLOSED_FORM:.0%} where told, or within the 95 % interval of all together",
                near and len(told) > 1,
            ),
            Check(
                "the same at 50 lux",
                "told, the chart being clipped",
                "withheld at every DX" if clipped else "told",
                "",
                None,
            ),
        ),
        (
            Figure(
                "MTF50 over speed, 30 ms, 20 lux",
                _SPEED,
                "MTF50 / cycles/px",
                (
                    Line("measured", speeds, [found[speed].value for speed in speeds], colour=0),
                    Line("closed form", speeds, [closed[speed] for speed in speeds], dashed=True, colour=1),
                ),
                logarithmic=False,
            ),
        ),
    )


def patch_snr(measured: Measurements) -> Found:
    """Of an even patch: motion changes nothing."""
    numbers = measured[AT_30_MS]
    grey = [numbers["patch_snr_dark", 30.0, speed] for speed in SPEEDS]
    white = [numbers["patch_snr_bright", 30.0, speed] for speed in SPEEDS]
    spread = _spread(each.value for each in grey)
    beside = "clipped, withheld" if not any(each.told for each in white) else "told"
    return Found(
        (
            Check(
                f"patch SNR at 30 ms and DX {_listed(SPEEDS)}",
                "constant",
                f"grey: {_listed([each.value for each in grey], '.2f')}",
                f"spread below {EVEN:.0%}",
                spread < EVEN,
            ),
            Check("the white patch", "constant", beside, "", None),
        ),
        (_over_exposure(measured[OVER_EXPOSURE], "patch_snr_dark", "Patch SNR, 18 % grey, 50 lux", "SNR"),),
    )


def edge_snr(measured: Measurements) -> Found:
    """Equal over speed at every exposure until the chart clips."""
    numbers = measured[OVER_EXPOSURE]
    spreads = {}
    for ms in OVER_EXPOSURE.exposures_ms:
        told = [numbers["edge_snr_db", ms, v].value for v in SPEEDS if numbers["edge_snr_db", ms, v].told]
        if len(told) == len(SPEEDS) and ms <= _CLIPS_MS:
            spreads[ms] = max(told) - min(told)
    text = ", ".join(f"{spread:.2f} dB at {ms:g} ms" for ms, spread in spreads.items())
    return Found(
        (
            Check(
                "edge SNR over DX below 20 ms",
                "equal",
                text or "nothing told",
                f"spread below {SPREAD_DB:g} dB",
                bool(spreads) and max(spreads.values()) < SPREAD_DB,
            ),
        ),
        (_over_exposure(numbers, "edge_snr_db", "Edge SNR over exposure, 50 lux", "Edge SNR / dB"),),
    )


def clipping(measured: Measurements) -> Found:
    """More light clips earlier, in proportion."""
    found = measured[CLIPPING]
    products = [lux * ms for lux, ms in found.items()]
    lights = list(found)
    return Found(
        (
            Check(
                f"exposure from which the chart clips at {_listed(lights)} lux",
                "the jump comes earlier in more light",
                f"{_listed(list(found.values()), '.1f')} ms: {_listed(products, '.0f')} lux ms",
                f"light times exposure within {INVERSE:.0%}",
                _spread(products) <= INVERSE,
            ),
        ),
        (
            Figure(
                "Exposure from which the chart clips",
                "Light / lux",
                _EXPOSURE,
                (
                    Line("measured", lights, list(found.values()), colour=0),
                    Line(
                        "inverse of the light",
                        lights,
                        [found[lights[0]] * lights[0] / lux for lux in lights],
                        dashed=True,
                        colour=1,
                    ),
                ),
            ),
        ),
    )


def capacity(measured: Measurements) -> Found:
    """Shannon information capacity, of the square of frequencies."""
    return _peaks(measured, "sic_square", "SIC", "bits/px")


def quanta_of_picture(measured: Measurements) -> Found:
    """Noise equivalent quanta over the band."""
    return _peaks(measured, "neq_integral", "NEQ", "quanta/px")


def _peaks(measured: Measurements, metric: str, name: str, unit: str) -> Found:
    """Where a metric peaks over exposure: in a range at rest; lower, and no later, the faster it moves."""
    numbers = measured[OVER_EXPOSURE]
    peaks = []
    for speed in SPEEDS:
        told = {ms: each.value for ms, each in _told(numbers, metric, speed).items()}
        place = max(told, key=lambda ms, of=told: of[ms])  # type: ignore[misc]
        peaks.append((place, told[place]))
    places, heights = zip(*peaks, strict=True)
    lower = all(after < before for before, after in pairwise(heights))
    no_later = all(after <= before for before, after in pairwise(places))
    return Found(
        (
            Check(
                f"{name} at rest",
                "peaks at 20-30 ms",
                f"highest told value at {places[0]:g} ms: {heights[0]:.3g} {unit}",
                f"peak within {PEAK_MS[0]:g}-{PEAK_MS[1]:g} ms",
                PEAK_MS[0] <= places[0] <= PEAK_MS[1],
            ),
            Check(
                f"{name}'s peak at DX {_listed(SPEEDS)}",
                "lower, and earlier, with DX",
                f"{_listed(places)} ms; {_listed(heights, '.3g')} {unit}",
                "height falls, place does not rise",
                lower and no_later,
            ),
        ),
        (
            _over_exposure(
                numbers,
                metric,
                f"{name} over exposure, 50 lux",
                f"{name} / {unit}",
                (20.0, 30.0, "peak at rest"),
            ),
        ),
    )


def mtf50(length_px: float) -> float:
    """MTF50, cycles/px, of the lin2024 camera across an edge at ``TILT_DEG`` from vertical, moved along x.

    The chart's pixel, the areas of the camera's disc in the pixels, and uniform motion.
    """
    areas = torch.from_numpy(convolution.disc(Camera.preset(CAMERA).defocus_radius_px))
    place = torch.arange(len(areas), dtype=torch.float64) - len(areas) // 2
    along = torch.tensor([math.cos(math.radians(TILT_DEG)), math.sin(math.radians(TILT_DEG))])

    def above_half(f: float) -> float:
        fx, fy = (torch.tensor([[f * float(part)]], dtype=torch.float64) for part in along)
        disc = (areas * torch.cos(2 * math.pi * (place * fx + place[:, None] * fy))).sum()
        moved = transfer.motion(fx, fy, torch.tensor([length_px, 0.0], dtype=torch.float64))
        return float(transfer.pixel(fx, fy) * disc * moved) - 0.5

    return float(brentq(above_half, 1e-4, min(0.4, 0.9 / max(length_px, 1e-9))))


def _line(numbers: Any, metric: str, speed: float) -> dict[float, Estimate]:
    return {ms: numbers[metric, ms, speed] for ms in OVER_EXPOSURE.exposures_ms}


def _told(numbers: Any, metric: str, speed: float) -> dict[float, Estimate]:
    """The values of a line that are not withheld, at least one; raises :class:`NotRun`."""
    told = {ms: each for ms, each in _line(numbers, metric, speed).items() if each.told}
    if not told:
        raise NotRun(f"{metric} is withheld at every exposure at {speed:g} px/s")
    return told


def _over_exposure(
    numbers: Any, metric: str, title: str, y_label: str, *quoted: tuple[float, float, str]
) -> Figure:
    exposures = OVER_EXPOSURE.exposures_ms
    lines = tuple(
        Line(f"{speed:g} px/s", exposures, [numbers[metric, ms, speed].value for ms in exposures])
        for speed in SPEEDS
    )
    clips = (_CLIPS_MS, _CLIPS_MS, "clips, in the paper")
    return Figure(title, _EXPOSURE, y_label, lines, quoted or (clips,))


def _spread(values: Iterable[float]) -> float:
    """Largest less smallest, as a share of the mean."""
    each = list(values)
    return (max(each) - min(each)) * len(each) / sum(each)


def _listed(values: Sequence[float], how: str = "g") -> str:
    return ", ".join(format(value, how) for value in values)
