"""Map of the longest exposure that keeps motion blur within a limit, for every pixel of a camera on a vehicle.

A map is of a scene: the road with the sky above it, or those behind a frontal plane; its figures are then of the
plane alone. Exposures in s, inf where nothing moves, NaN beyond what the lens sees.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from blurnoise._core.checks import limited
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m
from blurnoise.optics.spectra import Floats
from blurnoise_eval.plots.style import plain_numbers, small_multiples, tidy
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import finite
from blurnoise_eval.system.terminal import plain

COLUMNS = ("scene", "x_px", "y_px", "range_m", "flow_x_px_s", "flow_y_px_s", "longest_exposure_ms")
ROAD = "road and sky"
_DRAWN = 320  # points of a map along its longer side; it is smooth
_LISTED = 33
MOST_PLANES = 7
_MOST_LEVELS = 12


class ExposureMap(NamedTuple):
    """A scene, and what its pixels (2, H, W) see: ranges, m, flow (2, H, W), px/s, longest exposures, s.

    own: (H, W), the pixels that count in shares of the scene.
    """

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
        """Exposures for all of a scene, for half of it, and for places of the picture; inf where any will do.

        bottom_edge, horizon: of road and sky, the shortest along them; without a horizon where none is seen.
        """
        limits = {"all": self.at_share_s(1.0), "half": self.at_share_s(0.5)}
        if self.scene == ROAD:
            limits["bottom_edge"] = float(np.nanmin(self.longest_s[-1], initial=math.inf))
            sky = np.isinf(self.range_m)
            edge = sky[:-1] & np.isfinite(self.range_m[1:])
            if edge.any():
                limits["horizon"] = float(self.longest_s[:-1][edge].min())
        return limits

    def facts(self, exposure_s: float | None = None) -> dict[str, str | float | None]:
        """:meth:`limits_s` in ms for JSON, None without limit or horizon; with an exposure the share it serves."""
        found: dict[str, str | float | None] = {"scene": self.scene}
        found |= {f"{name}_ms": finite(1e3 * limit) for name, limit in self.limits_s().items()}
        if self.scene == ROAD:
            found.setdefault("horizon_ms", None)
        return found if exposure_s is None else found | {"share": self.share(exposure_s)}

    def sentence(self, blur_px: float, exposure_s: float | None = None) -> str:
        """What the map answers; with an exposure, how much of the scene it serves."""
        limits = {name: _ms(limit) for name, limit in self.limits_s().items()}
        half = f"keeps below {blur_px:g} px up to {limits['half']}"
        if exposure_s is not None:
            half += f"; {100 * self.share(exposure_s):.0f} % of it at {_ms(exposure_s)}"
        if self.scene != ROAD:
            return f"{blur_px:g} px, {self.scene}: {limits['all']} for all of it; half of it {half}"
        there = f", {limits['horizon']} at the horizon" if "horizon" in limits else ""
        return (
            f"{blur_px:g} px: {limits['bottom_edge']} at the bottom edge{there}; half of the picture {half}"
        )


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.3g} ms" if math.isfinite(time_s) else "no limit"


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
    if path.suffix == ".csv":
        lines = [",".join(COLUMNS)]
        for found in maps:
            columns = np.stack([*found.pixels, found.range_m, *found.flow_px_s, 1e3 * found.longest_s])
            for values in columns.reshape(len(columns), -1).T.tolist():
                lines.append(
                    ",".join([found.scene, *(f"{v:.6g}" if math.isfinite(v) else "" for v in values)])
                )
        write_whole(path, "".join(f"{line}\r\n" for line in lines).encode())
        return
    data = io.BytesIO()
    np.save(data, np.stack([1e3 * found.longest_s for found in maps]).astype(np.float32))
    write_whole(path, data.getvalue())


def draw(maps: Sequence[ExposureMap], view: View, blur_px: float, title: str) -> Figure:
    """Contours of the longest exposure on the picture plane, a panel for each map."""
    levels_ms = _levels(maps)
    tall = max(2.2, min(5.5, 4.4 * view.height_px / view.width_px))
    figure, panels = small_multiples(len(maps), min(2, len(maps)), (4.6, tall + 0.4), (0.9, 0.5))
    for axes, found in zip(panels, maps, strict=True):
        drawn = _panel(axes, found, view, levels_ms)
    bar = figure.colorbar(drawn, ax=panels, ticks=levels_ms, pad=0.02, aspect=40)
    bar.set_label(f"Longest exposure for {blur_px:g} px of motion blur / ms", fontsize=9)
    plain_numbers(bar.ax.yaxis)
    figure.suptitle(plain(title), fontsize=10, parse_math=False)
    return figure


def _panel(axes: Axes, found: ExposureMap, view: View, levels_ms: Sequence[float]) -> ContourSet:
    x, y = found.pixels
    shown = np.ma.masked_invalid(np.clip(1e3 * found.longest_s, 0.999 * levels_ms[0], 1.001 * levels_ms[-1]))
    norm = BoundaryNorm(levels_ms, 256, extend="both")
    drawn = axes.contourf(x, y, shown, levels_ms, cmap=colormaps["viridis"], norm=norm, extend="both")
    crossed = [level for level in levels_ms if shown.min() < level < shown.max()]
    if crossed:
        lines = axes.contour(x, y, shown, crossed, colors="k", linewidths=0.7)
        axes.clabel(lines, fmt=lambda level: f"{level:g} ms", fontsize=7.5)
    sky = np.isinf(found.range_m)
    if sky.any() and not sky.all():
        axes.contour(x, y, sky, [0.5], colors="w", linewidths=1.2, linestyles="--")  # the horizon
    tidy(axes, title=found.scene, x="x / px", y="y / px")
    axes.set(xlim=(-0.5, view.width_px - 0.5), ylim=(view.height_px - 0.5, -0.5), aspect="equal")
    return drawn


def _levels(maps: Sequence[ExposureMap]) -> list[float]:
    """1, 2, 5, 10 ... ms around what the maps hold, at least two, at most twelve from the shortest on."""
    times = 1e3 * np.concatenate([found.longest_s[np.isfinite(found.longest_s)] for found in maps])
    least, most = (float(times.min()), float(np.quantile(times, 0.98))) if times.size else (1.0, 1.0)
    ticks = LogLocator(subs=(1, 2, 5), numticks=99).tick_values(least / 2.5, 2.5 * most)
    levels = [float(tick) for tick in ticks if least / 2.5 < tick < 2.5 * max(most, 2 * least)]
    return levels[:_MOST_LEVELS]
