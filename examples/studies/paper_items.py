"""The items of the rerun in the paper's order, how each is compared with the paper, and what cannot be compared.

Metrics of charts are of the camera's linear numbers, before any coding, so both chains have the same. They are not
available once the chart clips; the paper reads on there, and sees MTF50 and SNR rise. A sign counts as detected where
its mean confidence over the noise fields is at or above the paper's 0.6, and as read where every noise field's is.
Signs are in the paper's chain; in the maps in the camera's, because in their light linear 8 bits leave too little. A
new item is a function and an entry of ``ITEMS``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from statistics import median
from typing import Any

from paper_checks import Check, Curve, Figure, Item, Parts, Range, even, falling, near, within
from paper_measurements import CAMERA, Grid, Measurements, NotRun, clips_from_ms
from scipy.stats import spearmanr

from blurnoise import Camera, blur_pixels, photoelectrons

TABLE_2 = (
    (3.938, 0.5, 25, 5, 30),
    (1.969, 0.5, 50, 5, 30),
    (0.985, 0.5, 100, 5, 30),
    (1.969, 0.5, 100, 10, 30),
    (3.937, 4.9, 100, 20, 30),
    (9.843, 4.9, 100, 50, 30),
    (19.675, 4.9, 50, 100, 15),
    (39.35, 4.9, 50, 100, 30),
    (19.687, 4.9, 100, 100, 30),
)
"""Blur as printed, px, and what it follows from: width and distance, m, speed, km/h, exposure, ms.

Widths, distances and exposures are reconstructed from the results: only speed times exposure and width over distance
enter. The speed of rows 7 and 8 is 27.778 m/s; the printed 13.889 is a misprint.
"""
PRINTED_PX = 0.005
QUANTA = 5774.616
"""Of white at 50 lux and 30 ms in the paper's tool."""

SPEEDS = (0.0, 150.0, 200.0, 500.0, 1000.0)
OVER_EXPOSURE = Grid((2, 5, 10, 15, 18, 21, 24, 27, 30, 45), SPEEDS)
OVER_SPEED = Grid((30,), (0.0, 50.0, 100.0, 150.0, 200.0, 350.0, 500.0), illuminance_lux=20.0)
CLIPPING_LUX = (20.0, 50.0, 100.0, 200.0)
NEAR, EVEN, SPREAD_DB = 0.01, 0.02, 0.5
"""How far MTF50 may be off, and equal numbers apart, as shares; and equal levels apart."""
CLIPS_MS = 20.0
CLIPS = (CLIPS_MS, CLIPS_MS, "clips, in the paper")
"""From here on the paper's lines at 50 lux rise: its chart clips."""
PEAK_MS = (18.0, 30.0)

LEVEL = 0.6
SIZES = (100, 50, 32)
TESTED_MS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 4, 5, 10, 20, *range(30, 95, 5))
FAR_DX = (0.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1000.0)
MAP: Any = {"illuminance_lux": 1.0, "camera": "imx250"}
"""Noise and blur both within the exposures of the map, and edges measurable where the detector is at its limit."""
MAP_GRID = (1, 2, 3, 5, 10, 20, 45, 90), (0.0, 50.0, 150.0, 300.0, 600.0, 1000.0)
METRICS = {"MTF50": "mtf50_x", "patch SNR": "patch_snr_bright", "SIC": "sic_square", "NEQ": "neq_integral"}
READ = (
    (100, 0.0, (1, 2, 20, 50, 60, 65, 70, 75, 80, 90), 1.0, 80.0),
    (50, 0.0, (1, 2, 4, 20, 40, 55, 60, 65, 70, 75, 80, 90), None, 75.0),
    (32, 0.0, (1, 2, 4, 8, 20, 30, 35, 40, 45, 50, 55, 60), 4.0, 40.0),
    (100, 200.0, (1, 2, 20, 32, 36, 40, 45, 50, 55, 60), None, 43.0),
    (50, 200.0, (1, 2, 4, 16, 25, 28, 32, 36, 40), 2.0, 32.0),
    (32, 200.0, (2, 4, 8, 16, 20, 22, 25, 28, 32), None, 22.0),
)
"""Of Figure 30: size in px, DX, exposures about the ends in ms, and the ends that the paper gives, where it does."""
FROM_FACTOR, TO_FACTOR = 2.0, 1.3
READ_DX = (0.0, 50.0, 100.0, 200.0, 350.0, 500.0)


def table_2(measurements: Measurements) -> Parts:
    """Motion blur of road users, row by row."""
    camera = Camera.preset(CAMERA)
    optics: Any = {"width_px": camera.sensor.width_px, "hfov_deg": camera.lens.hfov_deg}
    for number, (printed, width, distance, kmh, ms) in enumerate(TABLE_2, 1):
        blur_px = blur_pixels(kmh / 3.6, distance, 1e-3 * ms, target_width_m=width, **optics)
        what = f"row {number}: {width:g} m wide, {distance:g} m away, {kmh:g} km/h, {ms:g} ms"
        ends = printed - PRINTED_PX, printed + PRINTED_PX
        yield within(what, f"{printed:.3f} px", blur_px, *ends, "px", ".4f")


def quanta(measurements: Measurements) -> Parts:
    """Quanta of white light: the camera's electrons times the sensitivity by which the tool multiplies."""
    camera = Camera.preset(CAMERA)
    white = photoelectrons(camera, 50.0, 0.030) * camera.sensor.system_gain_dn_per_e
    expected, ends = f"{QUANTA:.1f} (its tool)", (0.999 * QUANTA, 1.001 * QUANTA)
    yield within("white at 50 lux, 30 ms", expected, white, *ends, "quanta", ".1f")


def mtf50_over_exposure(measurements: Measurements) -> Parts:
    """Flat at rest until the chart clips, and lower with speed."""
    at_rest = measurements.curve(OVER_EXPOSURE, "mtf50_x", dx=0.0)
    estimates = [measurements[OVER_EXPOSURE]["mtf50_x", ms, 0.0] for ms in at_rest]
    middle, last = median(at_rest.values()), max(at_rest)
    text = f"{middle:.3f} cycles/px to {last:g} ms"
    flat = near("MTF50 at rest", "flat to 20 ms", estimates, [middle] * len(estimates), text, NEAR)
    yield flat._replace(agrees=flat.agrees and last >= CLIPS_MS)
    clipped = (ms for ms in OVER_EXPOSURE.exposures_ms if ms not in at_rest and ms > CLIPS_MS)
    what, expected = "MTF50 at rest is not available from", "rises beyond 20 ms: an artefact of clipping"
    yield within(what, expected, min(clipped, default=math.inf), last, OVER_EXPOSURE.exposures_ms[-1], "ms")
    ms = max((ms for ms in at_rest if ms <= 21), default=min(at_rest))
    moving = measurements.curve(OVER_EXPOSURE, "mtf50_x", ms=ms)
    yield falling(f"MTF50 at {ms:g} ms over DX", "falls with DX", moving, ".3f")
    yield _over_exposure(measurements, "mtf50_x", "MTF50", "cycles/px")


def mtf50_over_speed(measurements: Measurements) -> Parts:
    """Lower with speed, in light in which nothing clips."""
    mtf50 = measurements.curve(OVER_SPEED, "mtf50_x", ms=30.0)
    yield falling("MTF50 over DX at 20 lux", "falls", mtf50, ".4f")
    lines = {"measured": mtf50}
    yield Figure("MTF50 over speed, 30 ms, 20 lux", "Speed / px/s", "MTF50 / cycles/px", lines)


def patch_snr(measurements: Measurements) -> Parts:
    """Of an even patch: motion changes nothing."""
    grey = measurements.curve(OVER_EXPOSURE, "patch_snr_dark", ms=30.0)
    yield even("grey at 30 ms over DX", "constant", grey.values(), ".2f", "", EVEN)
    yield _over_exposure(measurements, "patch_snr_dark", "Patch SNR, 18 % grey", "mean by deviation")


def edge_snr(measurements: Measurements) -> Parts:
    """Equal over speed at every exposure until the chart clips."""
    below = [ms for ms in OVER_EXPOSURE.exposures_ms if ms <= CLIPS_MS]
    curves = [measurements.curve(OVER_EXPOSURE, "edge_snr_db", ms=ms).values() for ms in below]
    worst = max(max(levels) - min(levels) for levels in curves)
    yield within("greatest spread over DX below 20 ms", "equal", worst, 0, SPREAD_DB, "dB", ".2f")
    yield _over_exposure(measurements, "edge_snr_db", "Edge SNR", "dB")


def clipping(measurements: Measurements) -> Parts:
    """More light clips earlier, in proportion."""
    clips_ms = {lux: clips_from_ms(lux) for lux in CLIPPING_LUX}
    products = [lux * ms for lux, ms in clips_ms.items()]
    what, expected = "light times exposure that clips", "the jump comes earlier in more light"
    yield even(what, expected, products, ".0f", "lux ms", EVEN)
    lines = {"measured": clips_ms, "inverse of the light": {lux: products[0] / lux for lux in clips_ms}}
    yield Figure("Exposure from which the chart clips", "Light / lux", "Exposure / ms", lines)


def peaks(metric: str, name: str, unit: str, measurements: Measurements) -> Parts:
    """Where a metric peaks over exposure: in a range at rest; lower, and no later, the faster it moves."""
    curves = [measurements.curve(OVER_EXPOSURE, metric, dx=speed) for speed in SPEEDS]
    places = [max(curve, key=lambda ms: (curve[ms], -ms)) for curve in curves]
    heights = {speed: max(curve.values()) for speed, curve in zip(SPEEDS, curves, strict=True)}
    yield within(f"{name}'s peak at rest", "at 20-30 ms", places[0], *PEAK_MS, "ms")
    lower = falling(f"{name}'s peak over DX", "lower, and earlier, with DX", heights, ".3g")
    agrees = lower.agrees and all(after <= before for before, after in pairwise(places))
    text = f"{lower.result} px/s; at {', '.join(f'{ms:g}' for ms in places)} ms"
    yield lower._replace(result=text, rule="height falls, place does not rise", agrees=agrees)
    yield _over_exposure(measurements, metric, name, unit, (20.0, 30.0, "peak at rest"))


def _over_exposure(
    measurements: Measurements, metric: str, name: str, unit: str, published: Range = CLIPS
) -> Figure:
    """A metric over exposure, a line for each speed."""
    lines = {f"{speed:g} px/s": measurements.curve(OVER_EXPOSURE, metric, dx=speed) for speed in SPEEDS}
    return Figure(f"{name} over exposure, 50 lux", "Exposure / ms", f"{name} / {unit}", lines, [published])


def detection(measurements: Measurements) -> Parts:
    """The order of sizes: a larger sign is detected in shorter exposures and at higher speeds."""
    at_rest = Grid(TESTED_MS, (0.0,), chain="paper", sizes_px=SIZES)
    at_30_ms = Grid((30,), FAR_DX, chain="paper", sizes_px=SIZES)
    rest = {f"{size} px": measurements.curve(at_rest, f"{size} px", dx=0.0) for size in SIZES}
    fast = {f"{size} px": measurements.curve(at_30_ms, f"{size} px", ms=30.0) for size in SIZES}
    first, lost = list(map(first_held, rest.values())), list(map(first_lost, fast.values()))
    what, expected = "first exposure at rest that finds it", "1 ms (100 px), 5 ms (32 px)"
    yield Check(what, expected, by_size(first, "ms"), "falls with size", rises(first))
    what, expected = "DX that loses it at 30 ms", "about 600 px/s (50 px), 200 px/s (32 px)"
    yield Check(what, expected, by_size(lost, "px/s"), "rises with size", rises([-each for each in lost]))
    yield Figure("Signs detected at rest, 50 lux", "Exposure / ms", "Mean confidence", rest)
    lost_at = [(600.0, 600.0, "50 px lost"), (200.0, 200.0, "32 px lost")]
    yield Figure("Signs detected at 30 ms, 50 lux", "Speed / px/s", "Mean confidence", fast, lost_at)


def maps(measurements: Measurements) -> Parts:
    """How well metrics rank the conditions of a map by the confidence in a sign of 32 px."""
    numbers = measurements[Grid(*MAP_GRID, **MAP)]
    confidence = measurements[Grid(*MAP_GRID, **MAP, chain="camera", sizes_px=(32,))]
    nodes = [(float(ms), dx) for ms in MAP_GRID[0] for dx in MAP_GRID[1]]
    known = [node for node in nodes if all(numbers[metric, *node].available for metric in METRICS.values())]
    if len(known) < 3:
        raise NotRun(f"metrics are not available at all but {len(known)} of {len(nodes)} conditions")
    scores = [confidence["32 px", *node].value for node in known]
    rank = {}
    for name, metric in METRICS.items():
        rank[name] = float(spearmanr([numbers[metric, *node].value for node in known], scores).statistic)
    what = f"rank correlation with confidence, {len(known)} of {len(nodes)} conditions measurable"
    text = ", ".join(f"{name} {value:.2f}" for name, value in rank.items())
    agrees = min(rank["SIC"], rank["NEQ"]) > max(rank["MTF50"], rank["patch SNR"])
    expected, rule = "MTF50, patch SNR poor; SIC, NEQ good", "SIC and NEQ each above both others"
    yield Check(what, expected, text, rule, agrees)


def reading(measurements: Measurements) -> Parts:
    """The exposures from which, and to which, STOP is read."""
    lines: dict[str, Curve] = {}
    published = []
    for size, dx, tested_ms, start_ms, stop_ms in READ:
        of = Grid(tested_ms, (dx,), chain="paper", sizes_px=(size,), read=True)
        label = f"{size} px, DX {dx:g}"
        lines[label] = curve = measurements.curve(of, f"{size} px", dx=dx)
        published.append((stop_ms, stop_ms, label))
        if start_ms is not None:
            low, high = start_ms / FROM_FACTOR, start_ms * FROM_FACTOR
            yield within(f"{label}: read from", f"{start_ms:g} ms", first_held(curve), low, high, "ms")
        low, high = stop_ms / TO_FACTOR, stop_ms * TO_FACTOR
        yield within(f"{label}: read to", f"{stop_ms:g} ms", last_held(curve), low, high, "ms")
    yield Figure("STOP read to, 50 lux", "Exposure / ms", "Least confidence", lines, published)


def reading_over_speed(measurements: Measurements) -> Parts:
    """The speeds at which STOP is read at 30 ms; those beside the paper's in the list of speeds agree, too."""
    of = Grid((30,), READ_DX, chain="paper", sizes_px=(100, 32), read=True)
    curves = {size: measurements.curve(of, size, ms=30.0) for size in ("100 px", "32 px")}
    yield within("32 px: fails by", "100 px/s", first_lost(curves["32 px"]), 50, 200, "px/s")
    yield within("100 px: reads to", "350 px/s", last_held(curves["100 px"]), 200, 500, "px/s")
    published = [(100.0, 100.0, "32 px fails by"), (350.0, 350.0, "100 px reads to")]
    yield Figure("STOP read at 30 ms, 50 lux", "Speed / px/s", "Least confidence", curves, published)


def first_held(curve: Curve) -> float:
    """The first x at or above ``LEVEL``; infinite where there is none."""
    return min((x for x, y in curve.items() if y >= LEVEL), default=math.inf)


def last_held(curve: Curve) -> float:
    """The last x at or above ``LEVEL``; minus infinite where there is none."""
    return max((x for x, y in curve.items() if y >= LEVEL), default=-math.inf)


def first_lost(curve: Curve) -> float:
    """The first x from which on the curve stays below ``LEVEL``; infinite where it never does."""
    return min((x for x in curve if x > last_held(curve)), default=math.inf)


def rises(values: Sequence[float]) -> bool:
    """Whether values nowhere fall, and the last is above the first."""
    return values[-1] > values[0] and all(after >= before for before, after in pairwise(values))


def by_size(values: Sequence[float], unit: str) -> str:
    """Of signs of ``SIZES``: '1 ms (100 px), none (50 px)'."""
    texts = (f"{value:g} {unit}" if math.isfinite(value) else "none" for value in values)
    return ", ".join(f"{text} ({size} px)" for text, size in zip(texts, SIZES, strict=True))


_EDGE, _BOTH = "slanted edge, lin2024", "both edges, lin2024, 50 lux, DX 0 to 1000"
_SIGNS = "signs of 100, 50 and 32 px, lin2024, 50 lux"
_FOUND = f"{_SIGNS}; another detector than YOLOv5m"
_READ = f"{_SIGNS}; PP-OCR of rapidocr (the paper: v3) in known boxes; read: STOP in every noise field"
_LENS = "f-theta lens, 4096 px over 99.32 degrees (printed as 99)"
_SIC = partial(peaks, "sic_square", "SIC", "bits/px")
_NEQ = partial(peaks, "neq_integral", "NEQ", "quanta/px")
ITEMS = (
    Item("table-2", "Motion blur of road users", "Table 2, eq. 14", _LENS, table_2),
    Item("quanta", "Light to quanta", "eq. 9-13", "lin2024, white at 50 lux, 30 ms", quanta),
    Item("mtf50", "MTF50 over exposure", "Figures 12, 13", f"{_EDGE}, 50 lux", mtf50_over_exposure),
    Item("mtf50-dx", "MTF50 over speed", "Figure 14", f"{_EDGE}, 30 ms, 20 lux", mtf50_over_speed),
    Item("patch-snr", "Patch SNR over speed", "Figure 15", "even patches, lin2024, 30 ms, 50 lux", patch_snr),
    Item("edge-snr", "Edge SNR over exposure", "Figure 16", f"{_EDGE}, 50 lux, DX 0 to 1000", edge_snr),
    Item("clipping", "Where edge SNR jumps", "Figure 17", f"{_EDGE}, 20 to 200 lux, at rest", clipping),
    Item("sic", "Shannon information capacity", "Figure 18", _BOTH, _SIC),
    Item("neq", "Noise equivalent quanta", "Figure 19", _BOTH, _NEQ),
    Item("detection", "Signs detected", "Figures 22, 23", _FOUND, detection),
    Item("maps", "Performance maps", "Figures 24-29", "sign of 32 px, imx250, 1 lux", maps),
    Item("ocr", "STOP read over exposure", "Figure 30", _READ, reading),
    Item("ocr-dx", "STOP read over speed", "Figure 31", f"{_READ}; 30 ms", reading_over_speed),
)
NOT_COMPARED = {
    "Figure 2": "a real photograph; its light was not published",
    "section 4.2.1": "the spatial frequencies of a sign do not depend on exposure",
    "Figures 10, 11": "pictures of BDD100K; their exposures and lights are unknown",
    "Figure 14, the peak at DX 20": "the blur of the paper's tool has integer lengths, and is 0 to 1.5 px",
    "Figures 12 to 19, the numbers": "measured with Imatest on its own charts; only shapes are compared",
    "Figures 22, 23, the confidences": "unknown weights of YOLOv5m; only the order of sizes is compared",
    "Figures 24 to 29, with lin2024": "its black level is 0 DN, so its charts clip where noise limits detection, and "
    "only blur remains",
    "Figures 30, 31, the confidences": "another version of PP-OCR; only where STOP is read is compared",
}
"""Parts of the paper that cannot be compared, and why."""
