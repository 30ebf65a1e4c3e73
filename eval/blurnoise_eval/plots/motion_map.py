"""Map of the longest exposure that keeps motion blur within a limit, for every pixel of a camera on a vehicle.

Scenes: the road with the sky above it, and frontal planes before them, each with figures of the plane alone.
Exposures in s, inf where nothing moves, NaN beyond what the lens sees.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from blurnoise._core.checks import limited
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m
from blurnoise.optics.spectra import Floats
from blurnoise_eval.plots.style import plain_numbers, small_multiples, tidy
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines, finite
from blurnoise_eval.system.terminal import plain

COLUMNS = ("scene", "x_px", "y_px", "range_m", "flow_x_px_s", "flow_y_px_s", "longest_exposure_ms")
ROAD = "road and sky"
_PLACES = {
    "bottom_edge": "at the bottom edge", "horizon": "at the horizon", "all": "for all of it", "half": "for half of it"
}  # fmt: skip
_DRAWN = 320  # points of a map along its longer side; it is smooth
_LISTED = 33
MOST_PLANES = 7
_MOST_LEVELS = 12


class ExposureMap(NamedTuple):
    """A scene: pixels (2, H, W), their ranges (H, W), m, flow (2, H, W), px/s, longest exposures, s, and which of
    them count in shares of the scene."""

    scene: str
    pixels: Floats
    range_m: Floats
    flow_px_s: Floats
    longest_s: Floats
    own: NDArray[np.bool_]

    def at_share_s(self, share: float) -> float:
        """The exposure up to which this share of the scene keeps within the limit; inf where none of it is seen."""
        seen = np.sort(self.longest_s[self.own])[::-1]
        return float(seen[max(0, math.ceil(share * seen.size) - 1)]) if seen.size else math.inf

    def share(self, exposure_s: float) -> float:
        """The share of the scene that keeps within the limit at an exposure."""
        return float((self.longest_s[self.own] >= exposure_s).mean()) if self.own.any() else 1.0

    def limits_s(self) -> dict[str, float]:
        """Exposures for all and half of a scene; of road and sky the shortest along the bottom edge and the horizon,
        where one is seen. inf: any."""
        limits = {}
        if self.scene == ROAD:
            limits["bottom_edge"] = float(np.nanmin(self.longest_s[-1], initial=math.inf))
            edge = np.isinf(self.range_m[:-1]) & np.isfinite(self.range_m[1:])
            if edge.any():
                limits["horizon"] = float(self.longest_s[:-1][edge].min())
        return limits | {"all": self.at_share_s(1.0), "half": self.at_share_s(0.5)}

    def facts(self, exposure_s: float | None = None) -> dict[str, str | float | None]:
        """:meth:`limits_s` in ms, None without limit; with an exposure the share of the scene within the limit."""
        limits = {f"{name}_ms": finite(1e3 * limit) for name, limit in self.limits_s().items()}
        return {"scene": self.scene, **limits} | ({"share": self.share(exposure_s)} if exposure_s else {})

    def sentence(self, blur_px: float, exposure_s: float | None = None) -> str:
        """The limits in words; with an exposure, the share of the scene within the limit."""
        limits = [
            f"{1e3 * limit:.3g} ms {_PLACES[name]}" if math.isfinite(limit) else f"no limit {_PLACES[name]}"
            for name, limit in self.limits_s().items()
        ]
        if exposure_s is not None:
            limits.append(
                f"{100 * self.share(exposure_s):.0f} % of it keeps within at {1e3 * exposure_s:.3g} ms"
            )
        return f"{blur_px:g} px, {self.scene}: {', '.join(limits)}"


def longest_exposure_s(flow_px_s: Floats, blur_px: float = 1.0) -> Floats:
    """The longest exposure (...) that keeps a flow's (2, ...) blur within blur_px (> 0); inf where nothing moves."""
    limited("blur_px", blur_px)
    with np.errstate(divide="ignore"):
        return np.asarray(blur_px / np.hypot(*flow_px_s))


def maps_of(
    view: View, mount: Vehicle, motion: EgoMotion, planes_m: Sequence[float] = (), *, blur_px: float = 1.0,
    most: int | None = _DRAWN,
) -> list[ExposureMap]:  # fmt: skip
    """The map of road and sky, then one for each frontal plane before them; most: points along a side, None: all.

    Raises ``ValueError`` for a picture of less than 2 x 2 px.
    """
    if min(view.width_px, view.height_px) < 2:
        size = f"{view.width_px}, {view.height_px}"
        raise ValueError(f"width_px, height_px = {size}: a map needs 2 px each way")
    pixels = view.pixels(most)
    rays = view.rays(pixels)
    road_m = mount.road_m(rays)
    found = []
    for plane_m in (None, *planes_m):
        scene, range_m, own = ROAD, road_m, np.isfinite(rays[0])
        if plane_m is not None:
            away_m = range_of_depth_m(rays, limited("planes_m", plane_m, "depth_m"))
            scene, range_m, own = f"plane at {plane_m:g} m", np.minimum(road_m, away_m), away_m < road_m
        flow = view.flow_px_s(pixels, range_m, motion)
        found.append(ExposureMap(scene, pixels, range_m, flow, longest_exposure_s(flow, blur_px), own))
    return found


def write_values(
    path: Path, view: View, mount: Vehicle, motion: EgoMotion, planes_m: Sequence[float], blur_px: float
) -> None:
    """Write maps as CSV, 33 points along a side, empty where there is no limit; or as .npy, (scenes, H, W) ms,
    float32, every pixel.

    Raises ``OSError``, ``ValueError`` for another ending.
    """
    if path.suffix not in (".csv", ".npy"):
        raise ValueError(f"values = {str(path)!r}: must end in .csv or .npy")
    most = _LISTED if path.suffix == ".csv" else None
    maps = maps_of(view, mount, motion, planes_m, blur_px=blur_px, most=most)
    if path.suffix == ".npy":
        data = io.BytesIO()
        np.save(data, np.stack([1e3 * found.longest_s for found in maps]).astype(np.float32))
        write_whole(path, data.getvalue())
        return
    rows = []
    for found in maps:
        columns = np.stack([*found.pixels, found.range_m, *found.flow_px_s, 1e3 * found.longest_s])
        for values in columns.reshape(len(columns), -1).T:
            rows.append(dict(zip(COLUMNS, [found.scene, *map(finite, values)], strict=True)))
    write_whole(path, "".join(csv_lines(COLUMNS, rows)).encode())


def draw(maps: Sequence[ExposureMap], view: View, blur_px: float, title: str) -> Figure:
    """Contours of the longest exposure on the picture plane, a panel for each map."""
    levels_ms = _levels(maps)
    norm = BoundaryNorm(levels_ms, 256, extend="both")
    tall = max(2.2, min(5.5, 4.4 * view.height_px / view.width_px))
    figure, panels = small_multiples(len(maps), min(2, len(maps)), (4.6, tall + 0.4), (0.9, 0.5))
    for axes, found in zip(panels, maps, strict=True):
        x, y = found.pixels
        within = np.clip(1e3 * found.longest_s, 0.999 * levels_ms[0], 1.001 * levels_ms[-1])
        shown = np.ma.masked_invalid(within)
        drawn = axes.contourf(x, y, shown, levels_ms, cmap="viridis", norm=norm, extend="both")
        crossed = [level for level in levels_ms if shown.min() < level < shown.max()]
        if crossed:
            lines = axes.contour(x, y, shown, crossed, colors="k", linewidths=0.7)
            axes.clabel(lines, fmt=lambda level: f"{level:g} ms", fontsize=7.5)
        sky = np.isinf(found.range_m)
        if sky.any() and not sky.all():
            axes.contour(x, y, sky, [0.5], colors="w", linewidths=1.2, linestyles="--")  # the horizon
        tidy(axes, title=found.scene, x="x / px", y="y / px")
        axes.set(xlim=(-0.5, view.width_px - 0.5), ylim=(view.height_px - 0.5, -0.5), aspect="equal")
    bar = figure.colorbar(drawn, ax=panels, ticks=levels_ms, pad=0.02, aspect=40)
    bar.set_label(f"Longest exposure for {blur_px:g} px of motion blur / ms", fontsize=9)
    plain_numbers(bar.ax.yaxis)
    figure.suptitle(plain(title), fontsize=10, parse_math=False)
    return figure


def _levels(maps: Sequence[ExposureMap]) -> list[float]:
    """1, 2, 5, 10 ... ms around what the maps hold, at least two, at most twelve from the shortest on."""
    times = 1e3 * np.concatenate([found.longest_s[np.isfinite(found.longest_s)] for found in maps])
    least, most = (float(times.min()), float(np.quantile(times, 0.98))) if times.size else (1.0, 1.0)
    ticks = LogLocator(subs=(1, 2, 5), numticks=99).tick_values(least / 2.5, 2.5 * most)
    levels = [float(tick) for tick in ticks if least / 2.5 < tick < 2.5 * max(most, 2 * least)]
    return levels[:_MOST_LEVELS]
