"""The page of a validation: one HTML file with pictures, photon transfer and all comparisons."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from blurnoise_eval.calibration import standard
from blurnoise_eval.measure.comparison import HEADS, summary
from blurnoise_eval.measure.frames import LevelPair, Validation
from blurnoise_eval.measure.statistics import Floats
from blurnoise_eval.plots.style import COLOURS, GREY, small_multiples, spread, tidy
from blurnoise_eval.report.page import write_page

_TEMPLATE = Path(__file__).parent / "templates" / "validation.html.j2"
_SHOWN_PX = 160
_MOST_PAIRS = 3
_CONTRAST = 4.0  # deviations about the mean, from black to white


def write(validation: Validation, folder: Path) -> Path:
    """Write ``folder``/validation.html; raises ``OSError``."""
    page = folder / "validation.html"
    write_page(
        page,
        _TEMPLATE,
        validation=validation,
        pictures=png(draw_pictures(validation.pairs)),
        transfer=png(draw_transfer(validation)),
        tables={kind: summary(validation.of(kind)) for kind in ("flat", "dark")},
        heads=HEADS,
        standard_heads=standard.HEADS,
    )
    return page


def draw_pictures(pairs: Sequence[LevelPair]) -> Figure:
    """The middle of real and simulated frames side by side, and of their differences of two frames.

    Shown are the darkest level and some flat ones; black to white is four deviations of the real frame each way.
    """
    dark, flat = ([pair for pair in pairs if pair.kind == kind] for kind in ("dark", "flat"))
    shown = [*dark[:1], *spread(flat, _MOST_PAIRS - len(dark[:1]))]
    figure, panels = small_multiples(4 * len(shown), 4, (2.5, 2.65), (0.0, 0.2))
    for row, pair in enumerate(shown):
        real, simulated = pair.real.frames, pair.simulated.frames
        for column, (title, picture, reference) in enumerate(
            (
                ("real", real[0], real[0]),
                ("simulated", simulated[0], real[0]),
                ("real, in time", real[0] - real[1], real[0] - real[1]),
                ("simulated, in time", simulated[0] - simulated[1], real[0] - real[1]),
            )
        ):
            axes, centre = panels[4 * row + column], float(np.median(reference))
            half = _CONTRAST * float(reference.std())
            axes.imshow(_middle(picture), "gray", vmin=centre - half, vmax=centre + half)
            axes.set(xticks=[], yticks=[])
            axes.set_title(f"{pair.name}\n{title}", fontsize=9, parse_math=False)
    return figure


def _middle(picture: Floats) -> Floats:
    top, left = (max(0, side - _SHOWN_PX) // 2 for side in picture.shape)
    return picture[top : top + _SHOWN_PX, left : left + _SHOWN_PX]


def draw_transfer(validation: Validation) -> Figure:
    """Variance over mean of both, and the differences of variances and of means with their intervals."""
    figure, (transfer, *panels) = small_multiples(3, 3, (4.2, 3.4), (0.0, 0.3))
    black = validation.camera.sensor.black_level_dn
    for kind, marker in (("dark", "s"), ("flat", "o")):
        means, variances = (validation.of(kind, name) for name in ("mean", "variance"))
        if not means:
            continue
        signal = [level.real - black for level in means]
        simulated = [level.simulated - black for level in means]
        style: Any = {"ls": "", "marker": marker, "ms": 5}
        transfer.plot(signal, [x.real for x in variances], color=COLOURS[0], label=f"real, {kind}", **style)
        open_marker: Any = {"color": COLOURS[1], "mfc": "none", "label": f"simulated, {kind}"}
        transfer.plot(simulated, [x.simulated for x in variances], **open_marker, **style)
        for axes, levels in zip(panels, (variances, means), strict=True):
            apart, low, high = (
                100 * np.array([getattr(level.difference, end) for level in levels])
                for end in ("value", "low", "high")
            )
            axes.errorbar(signal, apart, [apart - low, high - apart], color=COLOURS[0], capsize=2, **style)
    for axes in (transfer, *panels):
        axes.set_xscale("symlog", linthresh=10.0)
    transfer.set_yscale("log")
    x_label = "Mean above the black level / DN"
    tidy(transfer, x=x_label, y="Variance in time / DN²")
    for axes, name in zip(panels, ("variance", "mean"), strict=True):
        axes.axhline(0.0, color=GREY, lw=1.0)
        tidy(axes, x=x_label, y=f"Real {name} over simulated / %")
    transfer.legend(fontsize=8, frameon=False)
    return figure


def png(figure: Figure) -> str:
    """A figure as PNG in base64."""
    drawing = io.BytesIO()
    figure.savefig(drawing, format="png", dpi=100)
    return base64.b64encode(drawing.getvalue()).decode("ascii")
