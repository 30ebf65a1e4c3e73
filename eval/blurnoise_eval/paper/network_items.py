"""Items of networks: signs found, performance maps, text read (Figures 22 to 31), in both chains.

A sign counts as found where its mean confidence over the noise fields is at or above the paper's 0.6, and as read
where that of every noise field is; a reading that is not STOP has confidence 0. The paper's chain is judged, and the
camera's stands beside it. In the maps it is the other way round: in their light linear 8 bits leave too little.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from scipy.stats import spearmanr

from blurnoise_eval.paper.item import Check, Figure, Line, Parts
from blurnoise_eval.paper.measurement import CHAINS, Chain, Charts, Measurements, NotRun, Signs

SIZES = (100, 50, 32)
LEVEL = 0.6
FAST = 200.0
_TOPS_MS = (30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85, 90)
_REST_MS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 4, 5, 10, 20, *_TOPS_MS)
_DX = (0.0, 50.0, 100.0, 200.0, 350.0, 500.0)
_FAR_DX = (0.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1000.0)
_MAP_MS, _MAP_DX = (1, 2, 3, 5, 10, 20, 45, 90), (0.0, 50.0, 150.0, 300.0, 600.0, 1000.0)
MAP_CAMERA, MAP_LUX = "imx250", 1.0
"""Noise and blur both within the exposures of the map, and edges told where the detector is at its limit."""
FOUND_AT_REST = {
    "paper": Signs("paper", False, SIZES, _REST_MS, (0.0,)),
    "camera": Signs("camera", False, SIZES, (0.05, 0.1, 0.2, 0.5, 1, 4, 20, 50, 70, 90), (0.0,)),
}
FOUND_AT_30_MS = {chain: Signs(chain, False, SIZES, (30,), _FAR_DX) for chain in CHAINS}
_READ_MS = {
    (100, 0.0): (1, 2, 20, 50, 60, 65, 70, 75, 80, 90),
    (50, 0.0): (1, 2, 4, 20, 40, 55, 60, 65, 70, 75, 80, 90),
    (32, 0.0): (1, 2, 4, 8, 20, 30, 35, 40, 45, 50, 55, 60),
    (100, FAST): (1, 2, 20, 32, 36, 40, 45, 50, 55, 60),
    (50, FAST): (1, 2, 4, 16, 25, 28, 32, 36, 40),
    (32, FAST): (2, 4, 8, 16, 20, 22, 25, 28, 32),
}
"""Exposures about the ends that the paper gives, by size and DX; its own begin at 1 ms."""
_READ_BESIDE_MS = (4, 20, 50, 90)
READ_OVER_EXPOSURE = {
    (chain, size, dx): Signs(chain, True, (size,), exposures if chain == "paper" else _READ_BESIDE_MS, (dx,))
    for chain in CHAINS
    for (size, dx), exposures in _READ_MS.items()
}
READ_AT_30_MS = {chain: Signs(chain, True, (100, 32), (30,), _DX) for chain in CHAINS}
MAP_CHARTS = Charts(MAP_LUX, _MAP_MS, _MAP_DX, MAP_CAMERA)
MAP_SIGNS = {chain: Signs(chain, False, (32,), _MAP_MS, _MAP_DX, MAP_LUX, MAP_CAMERA) for chain in CHAINS}

FIRST_MS = {100: 1.0, 32: 5.0}
LOST_DX = {50: 600.0, 32: 200.0}
TOPS_MS = (75.0, 84.0)
READ_FROM_MS = {(32, 0.0): 4.0, (50, FAST): 2.0, (100, 0.0): 1.0}
READ_TO_MS = {
    (32, 0.0): 40.0, (50, 0.0): 75.0, (100, 0.0): 80.0, (32, FAST): 22.0, (50, FAST): 32.0, (100, FAST): 43.0,
}  # fmt: skip
"""Of Figure 30, by size and DX."""
FROM_FACTOR, TO_FACTOR = 2.0, 1.3
_EXPOSURE, _SPEED = "Exposure / ms", "Speed / px/s"
_CONFIDENCE, _LEAST = "Mean confidence", "Least confidence"
_METRICS = {"mtf50_x": "MTF50", "patch_snr_bright": "patch SNR", "sic_square": "SIC", "neq_integral": "NEQ"}
Curve = dict[float, float]
"""Confidence over exposure in ms, or over speed."""


def detection(measured: Measurements, chain: Chain) -> Parts:
    """The order of sizes: a larger sign is found in shorter exposures and at higher speeds."""
    over_ms = [_curve(measured, FOUND_AT_REST[chain], size) for size in SIZES]
    over_dx = [_curve(measured, FOUND_AT_30_MS[chain], size) for size in SIZES]
    first, last = [first_held(each) for each in over_ms], [last_held(each) for each in over_ms]
    lost = [first_lost(each) for each in over_dx]
    first_at = ", ".join(f"{ms:g} ms ({size} px)" for size, ms in FIRST_MS.items())
    lost_at = ", ".join(f"{dx:g} px/s ({size} px)" for size, dx in LOST_DX.items())
    found, gone = _by_size(first, "ms", "none"), _by_size(lost, "px/s", f"none to {_FAR_DX[-1]:g}")
    slower, tops = ordered([-each for each in lost]), f"{TOPS_MS[0]:g}-{TOPS_MS[1]:g} ms"
    limit, at_last = "another network's limit", _by_size(last, "ms", "none")
    yield Check("first exposure at rest that finds it", first_at, found, "falls with size", ordered(first))
    yield Check("DX that loses it at 30 ms", f"about {lost_at}", gone, "rises with size", slower)
    yield Check("last exposure at rest that finds it", tops, at_last, limit, None)
    if chain == "paper":
        rest, fast = (_lines(measured, signs.values()) for signs in (FOUND_AT_REST, FOUND_AT_30_MS))
        tops_at, places = [(*TOPS_MS, "last")], [(dx, dx, f"{size} px lost") for size, dx in LOST_DX.items()]
        yield Figure("Signs found at rest, 50 lux", _EXPOSURE, _CONFIDENCE, rest, tops_at, level=LEVEL)
        yield Figure("Signs found at 30 ms, 50 lux", _SPEED, _CONFIDENCE, fast, places, False, level=LEVEL)


def maps(measured: Measurements, chain: Chain) -> Parts:
    """How well metrics rank the conditions of a map by the confidence in a sign of 32 px."""
    numbers = measured[MAP_CHARTS]
    nodes = [(ms, dx) for ms in MAP_CHARTS.exposures_ms for dx in MAP_CHARTS.speeds_px_s]
    told = [node for node in nodes if all(numbers[name, *node].told for name in _METRICS)]
    if len(told) < 3:
        raise NotRun(f"metrics are withheld at all but {len(told)} of {len(nodes)} conditions")
    values = {name: [numbers[metric, *node].value for node in told] for metric, name in _METRICS.items()}
    confidence = [measured[MAP_SIGNS[chain]][32, *node] for node in told]
    rank = {name: float(spearmanr(each, confidence).statistic) for name, each in values.items()}
    what = f"rank correlation with confidence, {len(told)} of {len(nodes)} conditions told"
    text = ", ".join(f"{name} {value:.2f}" for name, value in rank.items())
    agrees = min(rank["SIC"], rank["NEQ"]) > max(rank["MTF50"], rank["patch SNR"])
    rule = "SIC and NEQ each above both others"
    yield Check(what, "MTF50, patch SNR poor; SIC, NEQ good", text, rule, agrees)
    for name, value in rank.items() if chain == "camera" else ():
        title, points = (
            f"Map of {name}: rank correlation {value:.2f}",
            [Line("32 px", values[name], confidence)],
        )
        yield Figure(title, name, _CONFIDENCE, points, points=True, level=LEVEL)


def reading(measured: Measurements, chain: Chain) -> Parts:
    """The exposures from which, and to which, STOP is read."""
    ends = ("from", READ_FROM_MS, FROM_FACTOR, first_held), ("to", READ_TO_MS, TO_FACTOR, last_held)
    for what, quoted, factor, end in ends:
        for (size, dx), ms in quoted.items():
            seen = end(_curve(measured, READ_OVER_EXPOSURE[chain, size, dx], size))
            text = f"{seen:g} ms" if math.isfinite(seen) else "not read"
            agrees = seen > 0 and ms / factor <= seen <= ms * factor
            yield Check(
                f"{size} px, DX {dx:g}: read {what}", f"{ms:g} ms", text, f"factor {factor:g}", agrees
            )
    for dx in (0.0, FAST) if chain == "paper" else ():
        lines = _lines(measured, (of for (_, _, at), of in READ_OVER_EXPOSURE.items() if at == dx))
        to_ms = [(ms, ms, f"{size} px to") for (size, at), ms in READ_TO_MS.items() if at == dx]
        yield Figure(f"STOP read, DX {dx:g}, 50 lux", _EXPOSURE, _LEAST, lines, to_ms, level=LEVEL)


def reading_over_speed(measured: Measurements, chain: Chain) -> Parts:
    """The speeds at which STOP is read at 30 ms."""
    of = READ_AT_30_MS[chain]
    fails, reads = first_lost(_curve(measured, of, 32)), last_held(_curve(measured, of, 100))
    failing = f"{fails:g} px/s" if math.isfinite(fails) else f"not to {_DX[-1]:g} px/s"
    until, rule = f"{reads:g} px/s" if math.isfinite(reads) else "not read", "a step of the DX list"
    yield Check("32 px: fails by", "100 px/s", failing, rule, one_step(fails, 100.0))
    yield Check("100 px: reads to", "350 px/s", until, rule, one_step(reads, 350.0))
    if chain == "paper":
        lines = _lines(measured, READ_AT_30_MS.values())
        quoted = [(100.0, 100.0, "32 px fails by"), (350.0, 350.0, "100 px reads to")]
        yield Figure("STOP read at 30 ms, 50 lux", _SPEED, _LEAST, lines, quoted, False, level=LEVEL)


def first_held(curve: Curve) -> float:
    """The first x at or above ``LEVEL``; infinite where there is none."""
    return min((x for x, y in curve.items() if y >= LEVEL), default=math.inf)


def last_held(curve: Curve) -> float:
    """The last x at or above ``LEVEL``; minus infinite where there is none."""
    return max((x for x, y in curve.items() if y >= LEVEL), default=-math.inf)


def first_lost(curve: Curve) -> float:
    """The first x from which on the curve stays below ``LEVEL``; infinite where it never does."""
    last = last_held(curve)
    return min((x for x in curve if x > last), default=math.inf)


def ordered(values: Sequence[float]) -> bool:
    """Whether values, of the largest sign first, rise to the smallest, and nowhere fall."""
    rises = all(after >= before for before, after in pairwise(values))
    return rises and values[-1] > values[0]


def one_step(found: float, quoted: float) -> bool:
    """Whether both are the same or neighbours among the speeds that are measured."""
    return found in _DX and abs(_DX.index(found) - _DX.index(quoted)) <= 1


def _curve(measured: Measurements, of: Signs, size: int) -> Curve:
    """Confidence in signs of a size over what ``of`` varies: exposure, or else speed."""
    over_ms = len(of.exposures_ms) > 1
    found: Mapping[tuple[int, float, float], float] = measured[of]
    return {ms if over_ms else dx: y for (px, ms, dx), y in sorted(found.items()) if px == size}


def _lines(measured: Measurements, signs: Iterable[Signs]) -> list[Line]:
    """A line per chain and size."""
    curves = [(of.chain, size, _curve(measured, of, size)) for of in signs for size in of.sizes_px]
    return [
        Line(f"{size} px, {chain}", list(curve), list(curve.values()), chain == "camera", SIZES.index(size))
        for chain, size, curve in curves
    ]


def _by_size(values: Sequence[float], unit: str, none: str) -> str:
    texts = (f"{value:g} {unit}" if math.isfinite(value) else none for value in values)
    return ", ".join(f"{text} ({size} px)" for text, size in zip(texts, SIZES, strict=True))
