"""Items of charts: MTF50, SNR, information capacity and NEQ over exposure and speed (Figures 12 to 19).

Metrics are of the camera's linear numbers, before any coding, so both chains have the same. Numbers are withheld once
the chart clips; the paper reads on there, and sees MTF50 and SNR rise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from statistics import median

import torch
from scipy.optimize import brentq

from blurnoise.blur import convolution
from blurnoise.metrics.values import Estimate
from blurnoise.optics import transfer
from blurnoise.optics.camera import Camera
from blurnoise_eval.paper.item import Check, Figure, Line, Parts, all_near, falls, listed, spread
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
Numbers = Mapping[tuple[str, float, float], Estimate]
"""Of a :class:`Charts`: by metric, ms and px/s."""


def mtf50_over_exposure(measured: Measurements) -> Parts:
    """Flat at rest until the chart clips, and lower with speed."""
    numbers = measured[OVER_EXPOSURE]
    told = _told(numbers, "mtf50_x", 0.0)
    values = [each.value for each in told.values()]
    middle = median(values)
    flat = all_near(told.values(), [middle] * len(told), FLAT)
    clipped = [ms for ms in OVER_EXPOSURE.exposures_ms if ms not in told and ms > _CLIPS_MS]
    all_after = bool(clipped) and max(told) < clipped[0]
    last = max((ms for ms in told if ms <= 21), default=min(told))
    by_speed = [numbers["mtf50_x", last, speed].value for speed in SPEEDS]
    at_rest = f"{middle:.3f} cycles/px, {spread(values):.1%} from end to end, to {max(told):g} ms"
    rule = f"within {FLAT:.0%} of the median, or it within the 95 % interval of all together"
    beyond = f"withheld from {clipped[0]:g} ms on" if clipped else "told throughout"
    artefact = "rises: an artefact of clipping"
    speeds = f"MTF50 at {last:g} ms and DX {listed(SPEEDS)}"
    yield Check("MTF50 at rest", "flat to 20 ms", at_rest, rule, flat and max(told) >= _CLIPS_MS)
    yield Check("MTF50 beyond", artefact, beyond, "withheld once the chart clips", all_after)
    yield Check(speeds, "falls with DX", listed(by_speed, ".3f"), "falls", falls(by_speed))
    yield _figure(numbers, "mtf50_x", "MTF50 over exposure, 50 lux", "MTF50 / cycles/px")


def mtf50_over_speed(measured: Measurements) -> Parts:
    """As the closed form has it, in light in which nothing clips."""
    numbers, speeds = measured[OVER_SPEED], OVER_SPEED.speeds_px_s
    found = {speed: numbers["mtf50_x", 30.0, speed] for speed in speeds}
    closed = {speed: mtf50(30e-3 * speed) for speed in speeds}
    told = {speed: each for speed, each in found.items() if each.told}
    worst = max((abs(each.value / closed[speed] - 1) for speed, each in told.items()), default=math.inf)
    near = all_near(told.values(), [closed[speed] for speed in told], CLOSED_FORM)
    text = ", ".join(f"{each.value:.4f} ({closed[speed]:.4f}) at {speed:g}" for speed, each in told.items())
    clipped = not any(measured[AT_30_MS]["mtf50_x", 30.0, speed].told for speed in SPEEDS)
    beside = f"{worst:.2%} off at most, told at {len(told)} of {len(speeds)} speeds"
    rule = f"within {CLOSED_FORM:.0%} where told, or within the 95 % interval of all together"
    what = "the same beside the closed form (in brackets)"
    at_50_lux = "withheld at every DX" if clipped else "told"
    several = len(told) > 1
    fell = several and falls(each.value for each in told.values())
    yield Check("MTF50 over DX at 20 lux", "falls", text, "falls", fell)
    yield Check(what, "pixel x disc x motion", beside, rule, near and several)
    yield Check("the same at 50 lux", "told, the chart being clipped", at_50_lux, "", None)
    measured_line = Line("measured", speeds, [each.value for each in found.values()])
    lines = [measured_line, Line("closed form", speeds, list(closed.values()), dashed=True)]
    title, y_label = "MTF50 over speed, 30 ms, 20 lux", "MTF50 / cycles/px"
    yield Figure(title, "Speed / px/s", y_label, lines, logarithmic=False)


def patch_snr(measured: Measurements) -> Parts:
    """Of an even patch: motion changes nothing."""
    numbers = measured[AT_30_MS]
    grey = [numbers["patch_snr_dark", 30.0, speed].value for speed in SPEEDS]
    white = any(numbers["patch_snr_bright", 30.0, speed].told for speed in SPEEDS)
    what, text = f"patch SNR at 30 ms and DX {listed(SPEEDS)}", f"grey: {listed(grey, '.2f')}"
    yield Check(what, "constant", text, f"spread below {EVEN:.0%}", spread(grey) < EVEN)
    yield Check("the white patch", "constant", "told" if white else "clipped, withheld", "", None)
    yield _figure(measured[OVER_EXPOSURE], "patch_snr_dark", "Patch SNR, 18 % grey, 50 lux", "SNR")


def edge_snr(measured: Measurements) -> Parts:
    """Equal over speed at every exposure until the chart clips."""
    numbers = measured[OVER_EXPOSURE]
    spreads = {}
    for ms in OVER_EXPOSURE.exposures_ms:
        over_speed = [numbers["edge_snr_db", ms, speed] for speed in SPEEDS]
        if ms <= _CLIPS_MS and all(each.told for each in over_speed):
            values = [each.value for each in over_speed]
            spreads[ms] = max(values) - min(values)
    text = ", ".join(f"{spread:.2f} dB at {ms:g} ms" for ms, spread in spreads.items())
    agrees = bool(spreads) and max(spreads.values()) < SPREAD_DB
    rule = f"spread below {SPREAD_DB:g} dB"
    yield Check("edge SNR over DX below 20 ms", "equal", text or "nothing told", rule, agrees)
    yield _figure(numbers, "edge_snr_db", "Edge SNR over exposure, 50 lux", "Edge SNR / dB")


def clipping(measured: Measurements) -> Parts:
    """More light clips earlier, in proportion."""
    found = measured[CLIPPING]
    lights, exposures = list(found), list(found.values())
    products = [lux * ms for lux, ms in found.items()]
    what = f"exposure from which the chart clips at {listed(lights)} lux"
    text = f"{listed(exposures, '.1f')} ms: {listed(products, '.0f')} lux ms"
    rule, earlier = f"light times exposure within {INVERSE:.0%}", "the jump comes earlier in more light"
    yield Check(what, earlier, text, rule, spread(products) <= INVERSE)
    inverse = [products[0] / lux for lux in lights]
    lines = [Line("measured", lights, exposures), Line("inverse of the light", lights, inverse, dashed=True)]
    yield Figure("Exposure from which the chart clips", "Light / lux", _EXPOSURE, lines)


def peaks(metric: str, name: str, unit: str, measured: Measurements) -> Parts:
    """Where a metric peaks over exposure: in a range at rest; lower, and no later, the faster it moves."""
    numbers = measured[OVER_EXPOSURE]
    highest = [
        max((each.value, -ms) for ms, each in _told(numbers, metric, speed).items()) for speed in SPEEDS
    ]
    heights, places = [height for height, _ in highest], [-later for _, later in highest]
    no_later = all(after <= before for before, after in pairwise(places))
    at_rest = f"highest told value at {places[0]:g} ms: {heights[0]:.3g} {unit}"
    inside = f"peak within {PEAK_MS[0]:g}-{PEAK_MS[1]:g} ms"
    what = f"{name}'s peak at DX {listed(SPEEDS)}"
    moving = f"{listed(places)} ms; {listed(heights, '.3g')} {unit}"
    lower = "height falls, place does not rise"
    yield Check(
        f"{name} at rest", "peaks at 20-30 ms", at_rest, inside, PEAK_MS[0] <= places[0] <= PEAK_MS[1]
    )
    yield Check(what, "lower, and earlier, with DX", moving, lower, falls(heights) and no_later)
    peak = (20.0, 30.0, "peak at rest")
    yield _figure(numbers, metric, f"{name} over exposure, 50 lux", f"{name} / {unit}", peak)


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


def _told(numbers: Numbers, metric: str, speed: float) -> dict[float, Estimate]:
    """The values over exposure that are not withheld, at least one; raises :class:`NotRun`."""
    line = {ms: numbers[metric, ms, speed] for ms in OVER_EXPOSURE.exposures_ms}
    told = {ms: each for ms, each in line.items() if each.told}
    if not told:
        raise NotRun(f"{metric} is withheld at every exposure at {speed:g} px/s")
    return told


def _figure(
    numbers: Numbers,
    metric: str,
    title: str,
    y_label: str,
    quoted: tuple[float, float, str] = (_CLIPS_MS, _CLIPS_MS, "clips, in the paper"),
) -> Figure:
    exposures = OVER_EXPOSURE.exposures_ms
    lines = [
        Line(f"{speed:g} px/s", exposures, [numbers[metric, ms, speed].value for ms in exposures])
        for speed in SPEEDS
    ]
    return Figure(title, _EXPOSURE, y_label, lines, [quoted])
