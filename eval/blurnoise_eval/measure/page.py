"""The page of a validation: one HTML file with pictures, photon transfer and all comparisons."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from blurnoise_eval.measure.comparison import AGREES, CANNOT_TELL, DIFFERS, EVERY, Comparison, Floats
from blurnoise_eval.measure.frames import Pair, Validation
from blurnoise_eval.plots.style import COLOURS, GREY, small_multiples, spread, tidy
from blurnoise_eval.report.page import write_page

_TEMPLATE = Path(__file__).parent / "templates" / "validation.html.j2"
_SHOWN_PX = 160
_MOST_PAIRS = 3
_VERDICTS = (AGREES, DIFFERS, CANNOT_TELL)
_CONTRAST = 4.0  # deviations about the mean, from black to white
HEADS = ("measure", "verdict", "largest difference", "real", "simulated")


def write(found: Validation, folder: Path) -> Path:
    """Write ``folder``/validation.html; raises ``OSError``."""
    page = folder / "validation.html"
    write_page(
        page,
        _TEMPLATE,
        found=found,
        pictures=_png(draw_pictures(found.pairs)),
        transfer=_png(draw_transfer(found)),
        cells=cells,
        tables={kind: summary(found, kind) for kind in ("flat", "dark")},
        heads=HEADS,
    )
    return page


def summary(found: Validation, kind: str) -> list[tuple[list[str], str]]:
    """A row per measure of dark or flat frames, as ``HEADS``, of the level that differs most; and its verdict."""
    rows = []
    for measure in EVERY:
        levels = found.of(measure.name, kind)
        if not levels:
            continue
        known = [each for each in levels if np.isfinite(each.difference)]
        worst = max(known or levels, key=lambda each: abs(each.difference))
        agree, differ = (sum(each.verdict == verdict for each in levels) for verdict in (AGREES, DIFFERS))
        verdict = DIFFERS if differ else AGREES if agree else CANNOT_TELL
        text = f"{differ} of {len(levels)} differ" if differ else f"{agree} of {len(levels)} agree"
        text = verdict if max(agree, differ) in (0, len(levels)) else text
        rows.append(([measure.title, text, *cells(worst)], verdict))
    return rows


def cells(each: Comparison) -> tuple[str, str, str]:
    """The difference with its interval, real and simulated, as text."""
    digits = ".4g" if each.measure.scale != "absolute" else ".4f"
    numbers = (f"{each.real:{digits}}", f"{each.simulated:{digits}}")
    if not np.isfinite(each.difference):
        return ("-", *numbers)
    ends = (each.difference, each.low, each.high)
    if each.measure.scale != "relative":
        return ("{:+.3f} ({:+.3f}, {:+.3f})".format(*ends), *numbers)
    if each.difference > 1:
        return ("x {:.3g} ({:.3g}, {:.3g})".format(*(1 + share for share in ends)), *numbers)
    return ("{} ({}, {}) %".format(*map(_percent, ends)), *numbers)


def _percent(share: float) -> str:
    return f"{100 * share:+.0f}" if abs(share) >= 0.0995 else f"{100 * share:+.2g}"


def draw_pictures(pairs: Sequence[Pair]) -> Figure:
    """The middle of a real and a simulated frame side by side, of the darkest and of some flat levels, at one scale
    for both, with contrast stretched to four deviations; and their differences of two frames."""
    dark, flat = ([pair for pair in pairs if pair.kind == kind] for kind in ("dark", "flat"))
    shown = [*dark[:1], *spread(flat, _MOST_PAIRS - len(dark[:1]))]
    figure, panels = small_multiples(4 * len(shown), 4, (2.5, 2.65), (0.0, 0.2))
    for place, axes in enumerate(panels):
        pair, column = shown[place // 4], place % 4
        frames = (pair.real, pair.simulated)[column % 2]
        picture = frames[0] if column < 2 else frames[0] - frames[1]
        scale = pair.real[0] if column < 2 else pair.real[0] - pair.real[1]
        middle, deviation = float(np.median(scale)), float(scale.std())
        half = _CONTRAST * deviation
        axes.imshow(_middle(picture), "gray", vmin=middle - half, vmax=middle + half)
        axes.set(xticks=[], yticks=[])
        what = ("real", "simulated", "real, in time", "simulated, in time")[column]
        axes.set_title(f"{pair.name}\n{what}", fontsize=9, parse_math=False)
    return figure


def _middle(picture: Floats) -> Floats:
    top, left = (max(0, side - _SHOWN_PX) // 2 for side in picture.shape)
    return picture[top : top + _SHOWN_PX, left : left + _SHOWN_PX]


def draw_transfer(found: Validation) -> Figure:
    """Variance over mean of both, the ratio of variances with its interval, and that of means."""
    figure, (transfer, *ratios) = small_multiples(3, 3, (4.2, 3.4), (0.0, 0.3))
    black = found.camera.sensor.black_level_dn
    for kind, marker in (("dark", "s"), ("flat", "o")):
        means, variances = found.of("mean", kind), found.of("variance", kind)
        if not means:
            continue
        for name, colour, fill in (("real", COLOURS[0], COLOURS[0]), ("simulated", COLOURS[1], "none")):
            x, y = ([getattr(each, name) for each in of] for of in (means, variances))
            x = [value - black for value in x]
            transfer.plot(x, y, marker, color=colour, mfc=fill, ms=5, label=f"{name}, {kind}")
        for axes, levels in zip(ratios, (variances, means), strict=True):
            at = [each.real - black for each in means]
            apart, low, high = (
                100 * np.array([getattr(each, name) for each in levels])
                for name in ("difference", "low", "high")
            )
            axes.errorbar(
                at,
                apart,
                [apart - low, high - apart],
                fmt=marker,
                color=COLOURS[0],
                ms=4.5,
                capsize=2,
                label=kind,
            )
    for axes in (transfer, *ratios):
        axes.set_xscale("symlog", linthresh=10.0)
    transfer.set_yscale("log")
    x_label = "Mean above the black level / DN"
    tidy(transfer, x=x_label, y="Variance in time / DN²")
    for axes, name in zip(ratios, ("variance", "mean"), strict=True):
        axes.axhline(0.0, color=GREY, lw=1.0)
        tidy(axes, x=x_label, y=f"Real {name} over simulated / %")
    transfer.legend(fontsize=8, frameon=False)
    return figure


def _png(figure: Figure) -> str:
    drawing = io.BytesIO()
    figure.savefig(drawing, format="png", dpi=100)
    return base64.b64encode(drawing.getvalue()).decode("ascii")
