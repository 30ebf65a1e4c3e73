"""Items of networks: signs found, performance maps, text read (Figures 22 to 31), in both chains.

A sign counts as found where its mean confidence over the noise fields is at or above the paper's 0.6, and as read
where that of every noise field is; a reading that is not STOP has confidence 0. The paper's chain is judged, and the
camera's stands beside it. In the maps it is the other way round: in their light linear 8 bits leave too little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from scipy.stats import spearmanr

from blurnoise_eval.paper.chains import CHAINS, Chain
from blurnoise_eval.paper.item import Check, Figure, Found, Line
from blurnoise_eval.paper.measurement import Charts, Measurements, Signs

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

_BESIDE_MS = (0.5, 1, 4, 20, 50, 70, 90)
"""Of the camera's chain, where nothing is judged."""
FOUND_AT_REST = {
    "paper": Signs("paper", False, SIZES, _REST_MS, (0.0,)),
    "camera": Signs("camera", False, SIZES, (0.05, 0.1, 0.2, *_BESIDE_MS), (0.0,)),
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
    chain: {
        (size, dx): Signs(chain, True, (size,), exposures if chain == "paper" else _READ_BESIDE_MS, (dx,))
        for (size, dx), exposures in _READ_MS.items()
    }
    for chain in CHAINS
}
READ_AT_30_MS = {chain: Signs(chain, True, (100, 32), (30,), _DX) for chain in CHAINS}
MAP_CHARTS = Charts(MAP_LUX, _MAP_MS, _MAP_DX, MAP_CAMERA)
MAP_SIGNS = {chain: Signs(chain, False, (32,), _MAP_MS, _MAP_DX, MAP_LUX, MAP_CAMERA) for chain in CHAINS}

FIRST_MS = {100: 1.0, 32: 5.0}
LOST_DX = {50: 600.0, 32: 200.0}
TOPS_MS = (75.0, 84.0)
READ_FROM_MS = ((32, 0.0, 4.0), (50, FAST, 2.0), (100, 0.0, 1.0))
"""Size, DX and ms of Figure 30."""
READ_TO_MS = {0.0: {32: 40.0, 50: 75.0, 100: 80.0}, FAST: {32: 22.0, 50: 32.0, 100: 43.0}}
FROM_FACTOR, TO_FACTOR = 2.0, 1.3
_EXPOSURE, _SPEED = "Exposure / ms", "Speed / px/s"
_CONFIDENCE, _LEAST = "Mean confidence", "Least confidence"


def detection(measured: Measurements) -> Found:
    """The order of sizes: a larger sign is found in shorter exposures and at higher speeds."""
    checks, rest, fast = [], [], []
    for chain in CHAINS:
        at_rest, moving = measured[FOUND_AT_REST[chain]], measured[FOUND_AT_30_MS[chain]]
        over_ms = {size: _over_ms(at_rest, size, 0.0) for size in SIZES}
        over_dx = {size: _over_dx(moving, size) for size in SIZES}
        first = [first_held(over_ms[size]) for size in SIZES]
        tops = [last_held(over_ms[size]) for size in SIZES]
        lost = [first_lost(over_dx[size]) for size in SIZES]
        judged = chain == "paper"
        checks += [
            Check(
                "first exposure at rest that finds it",
                _quoted(FIRST_MS, "ms"),
                _by_size(first, "ms", "none"),
                "falls with size",
                ordered(first) if judged else None,
                chain,
            ),
            Check(
                "DX that loses it at 30 ms",
                "about " + _quoted(LOST_DX, "px/s"),
                _by_size(lost, "px/s", f"none to {_FAR_DX[-1]:g}"),
                "rises with size",
                ordered([-each for each in lost]) if judged else None,
                chain,
            ),
            Check(
                "last exposure at rest that finds it",
                f"{TOPS_MS[0]:g}-{TOPS_MS[1]:g} ms",
                _by_size(tops, "ms", "none"),
                "another network's limit",
                None,
                chain,
            ),
        ]
        rest += [_drawn(over_ms[size], size, chain) for size in SIZES]
        fast += [_drawn(over_dx[size], size, chain) for size in SIZES]
    return Found(
        tuple(checks),
        (
            Figure(
                "Signs found at rest, 50 lux",
                _EXPOSURE,
                _CONFIDENCE,
                tuple(rest),
                ((*TOPS_MS, "last"),),
                level=LEVEL,
            ),
            Figure(
                "Signs found at 30 ms, 50 lux",
                _SPEED,
                _CONFIDENCE,
                tuple(fast),
                tuple((dx, dx, f"{size} px lost") for size, dx in LOST_DX.items()),
                logarithmic=False,
                level=LEVEL,
            ),
        ),
    )


def maps(measured: Measurements) -> Found:
    """How well metrics rank the conditions of a map by the confidence in a sign of 32 px."""
    numbers = measured[MAP_CHARTS]
    names = {"mtf50_x": "MTF50", "patch_snr_bright": "patch SNR", "sic_square": "SIC", "neq_integral": "NEQ"}
    nodes = [(ms, dx) for ms in MAP_CHARTS.exposures_ms for dx in MAP_CHARTS.speeds_px_s]
    told = [node for node in nodes if all(numbers[name, *node].told for name in names)]
    checks: list[Check] = []
    figures: list[Figure] = []
    for chain in CHAINS:
        seen = measured[MAP_SIGNS[chain]]
        confidence = [seen[32, *node] for node in told]
        rank = {
            name: float(spearmanr([numbers[metric, *node].value for node in told], confidence).statistic)
            for metric, name in names.items()
        }
        better = min(rank["SIC"], rank["NEQ"]) > max(rank["MTF50"], rank["patch SNR"])
        checks.append(
            Check(
                f"rank correlation with confidence, {len(told)} of {len(nodes)} conditions told",
                "MTF50, patch SNR poor; SIC, NEQ good",
                ", ".join(f"{name} {value:.2f}" for name, value in rank.items()),
                "SIC and NEQ each above both others",
                better if chain == "camera" else None,
                chain,
            )
        )
        if chain == "camera":
            figures = [
                Figure(
                    f"Map of {name}: rank correlation {rank[name]:.2f}",
                    name,
                    _CONFIDENCE,
                    (Line("32 px", [numbers[metric, *node].value for node in told], confidence),),
                    points=True,
                    level=LEVEL,
                )
                for metric, name in names.items()
            ]
    return Found(tuple(checks), tuple(figures))


def reading(measured: Measurements) -> Found:
    """The exposures from which, and to which, STOP is read."""
    checks, figures = [], []
    for chain in CHAINS:
        judged = chain == "paper"
        for size, dx, quoted in READ_FROM_MS:
            found = first_held(_read(measured, chain, size, dx))
            checks.append(
                Check(
                    f"{size} px, DX {dx:g}: read from",
                    f"{quoted:g} ms",
                    _exposure(found),
                    f"factor {FROM_FACTOR:g}",
                    within(found, quoted, FROM_FACTOR) if judged else None,
                    chain,
                )
            )
        for dx, by_size in READ_TO_MS.items():
            for size, quoted in by_size.items():
                found = last_held(_read(measured, chain, size, dx))
                checks.append(
                    Check(
                        f"{size} px, DX {dx:g}: read to",
                        f"{quoted:g} ms",
                        _exposure(found),
                        f"factor {TO_FACTOR:g}",
                        within(found, quoted, TO_FACTOR) if judged else None,
                        chain,
                    )
                )
    for dx, by_size in READ_TO_MS.items():
        lines = [_drawn(_read(measured, chain, size, dx), size, chain) for chain in CHAINS for size in SIZES]
        quoted_places = tuple((ms, ms, f"{size} px to") for size, ms in by_size.items())
        figures.append(
            Figure(
                f"STOP read, DX {dx:g}, 50 lux",
                _EXPOSURE,
                _LEAST,
                tuple(lines),
                quoted_places,
                level=LEVEL,
            )
        )
    return Found(tuple(checks), tuple(figures))


def reading_over_speed(measured: Measurements) -> Found:
    """The speeds at which STOP is read at 30 ms."""
    checks, lines = [], []
    for chain in CHAINS:
        over_dx = {size: _over_dx(measured[READ_AT_30_MS[chain]], size) for size in (100, 32)}
        judged = chain == "paper"
        fails, reads = first_lost(over_dx[32]), last_held(over_dx[100])
        checks += [
            Check(
                "32 px: fails by",
                "100 px/s",
                f"{fails:g} px/s" if math.isfinite(fails) else f"not to {_DX[-1]:g} px/s",
                "a step of the DX list",
                one_step(fails, 100.0) if judged else None,
                chain,
            ),
            Check(
                "100 px: reads to",
                "350 px/s",
                f"{reads:g} px/s" if math.isfinite(reads) else "not read",
                "a step of the DX list",
                one_step(reads, 350.0) if judged else None,
                chain,
            ),
        ]
        lines += [_drawn(curve, size, chain) for size, curve in over_dx.items()]
    quoted = ((100.0, 100.0, "32 px fails by"), (350.0, 350.0, "100 px reads to"))
    return Found(
        tuple(checks),
        (Figure("STOP read at 30 ms, 50 lux", _SPEED, _LEAST, tuple(lines), quoted, False, level=LEVEL),),
    )


def first_held(curve: Mapping[float, float]) -> float:
    """The first x at or above ``LEVEL``; infinite where there is none."""
    return min((x for x, y in curve.items() if y >= LEVEL), default=math.inf)


def last_held(curve: Mapping[float, float]) -> float:
    """The last x at or above ``LEVEL``; minus infinite where there is none."""
    return max((x for x, y in curve.items() if y >= LEVEL), default=-math.inf)


def first_lost(curve: Mapping[float, float]) -> float:
    """The first x from which on the curve stays below ``LEVEL``; infinite where it never does."""
    last = last_held(curve)
    return min((x for x in curve if x > last), default=math.inf)


def ordered(values: Sequence[float]) -> bool:
    """Whether values, of the largest sign first, rise to the smallest, and nowhere fall."""
    rises = all(after >= before for before, after in pairwise(values))
    return rises and values[-1] > values[0]


def within(found: float, quoted: float, factor: float) -> bool:
    """Whether the two differ by no more than the factor."""
    return found > 0 and quoted / factor <= found <= quoted * factor


def one_step(found: float, quoted: float) -> bool:
    """Whether both are the same or neighbours among the speeds that are measured."""
    return found in _DX and abs(_DX.index(found) - _DX.index(quoted)) <= 1


def _read(measured: Measurements, chain: Chain, size: int, dx: float) -> dict[float, float]:
    return _over_ms(measured[READ_OVER_EXPOSURE[chain][size, dx]], size, dx)


def _over_ms(seen: Mapping[tuple[int, float, float], float], size: int, dx: float) -> dict[float, float]:
    return {ms: y for (of, ms, at), y in sorted(seen.items()) if of == size and at == dx}


def _over_dx(seen: Mapping[tuple[int, float, float], float], size: int) -> dict[float, float]:
    return {dx: y for (of, _, dx), y in sorted(seen.items()) if of == size}


def _drawn(curve: Mapping[float, float], size: int, chain: Chain) -> Line:
    label = f"{size} px, {chain}"
    return Line(label, list(curve), list(curve.values()), chain == "camera", SIZES.index(size))


def _quoted(by_size: Mapping[int, float], unit: str) -> str:
    return ", ".join(f"{value:g} {unit} ({size} px)" for size, value in by_size.items())


def _by_size(values: Sequence[float], unit: str, none: str) -> str:
    texts = (f"{value:g} {unit}" if math.isfinite(value) else none for value in values)
    return ", ".join(f"{text} ({size} px)" for text, size in zip(texts, SIZES, strict=True))


def _exposure(ms: float) -> str:
    return f"{ms:g} ms" if math.isfinite(ms) else "not read"
