"""Map of the longest exposure that keeps motion blur within a limit, for every pixel of a camera on a vehicle.

A map is of a scene: the road with the sky above it, or those behind a frontal plane; its figures are then of the
plane alone. Exposures in s, inf where nothing moves, NaN beyond what the lens sees.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from numpy.typing import NDArray

from blurnoise._core.checks import limited
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m
from blurnoise.optics.spectra import Floats
from blurnoise_eval.plots.style import COLOURS, plain_numbers, tidy
from blurnoise_eval.system.files import plot_suffix, write_figure, write_whole
from blurnoise_eval.system.tables import csv_lines, finite
from blurnoise_eval.system.terminal import plain

COLUMNS = (
    "scene", "x_px", "y_px", "range_m", "flow_x_px_s", "flow_y_px_s", "longest_exposure_ms",
)  # fmt: skip
ROAD = "road and sky"
_DRAWN = 320  # points of a map along its longer side; it is smooth
_LISTED = 33
MOST_PLANES = 7
_MOST_LEVELS = 12
_ROAD_M = (3, 5, 10, 20, 50, 100)


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


def bottom_edge_s(found: ExposureMap) -> float:
    """The longest exposure at the bottom edge, the shortest along it."""
    return float(np.nanmin(found.longest_s[-1], initial=math.inf))


def horizon_s(found: ExposureMap) -> float | None:
    """The longest exposure for the sky just above the road, the shortest along it; None where it is not seen."""
    sky = np.isinf(found.range_m)
    edge = sky[:-1] & np.isfinite(found.range_m[1:])
    return float(found.longest_s[:-1][edge].min()) if edge.any() else None


def facts(found: ExposureMap, exposure_s: float | None = None) -> dict[str, str | float | None]:
    """A map in numbers: exposures, ms, that hold for all of the scene, for half of it and at places of the picture.

    None: any exposure does, or there is no such place. With an exposure, the share of the scene that it serves.
    """
    limits: dict[str, float | None] = {"all_ms": found.at_share_s(1.0), "half_ms": found.at_share_s(0.5)}
    if found.scene == ROAD:
        limits |= {"bottom_edge_ms": bottom_edge_s(found), "horizon_ms": horizon_s(found)}
    share = {} if exposure_s is None else {"share": found.share(exposure_s)}
    numbers = {name: None if limit is None else finite(1e3 * limit) for name, limit in limits.items()}
    return {"scene": found.scene, **numbers, **share}


def sentences(maps: Sequence[ExposureMap], blur_px: float, exposure_s: float | None = None) -> Iterator[str]:
    """What the maps answer, one for each; with an exposure, how much of the scene it serves."""
    limit = f"{blur_px:g} px"
    for found in maps:
        half = f"keeps below {limit} up to {_ms(found.at_share_s(0.5))}"
        if exposure_s is not None:
            half += f"; {100 * found.share(exposure_s):.0f} % of it at {_ms(exposure_s)}"
        if found.scene != ROAD:
            yield f"{limit}, {found.scene}: {_ms(found.at_share_s(1.0))} for all of it; half of it {half}"
            continue
        horizon = horizon_s(found)
        there = "" if horizon is None else f", {_ms(horizon)} at the horizon"
        yield f"{limit}: {_ms(bottom_edge_s(found))} at the bottom edge{there}; half of the picture {half}"


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.3g} ms" if math.isfinite(time_s) else "no limit"


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
        write_whole(path, (line.encode() for line in csv_lines(COLUMNS, _csv_rows(maps))))
        return
    data = io.BytesIO()
    np.save(data, np.stack([1e3 * found.longest_s for found in maps]).astype(np.float32))
    write_whole(path, data.getvalue())


def _csv_rows(maps: Sequence[ExposureMap]) -> Iterator[dict[str, object]]:
    for found in maps:
        columns = (*found.pixels, found.range_m, *found.flow_px_s, 1e3 * found.longest_s)
        for values in zip(*(np.ravel(column).tolist() for column in columns), strict=True):
            numbers = (f"{value:.6g}" if math.isfinite(value) else "" for value in values)
            yield dict(zip(COLUMNS, (found.scene, *numbers), strict=True))


def write(
    maps: Sequence[ExposureMap], view: View, mount: Vehicle, blur_px: float, title: str, path: Path
) -> None:
    """Write :func:`draw`'s figure as PNG, SVG or PDF. Raises ``OSError``, ``ValueError``."""
    plot_suffix(path)  # raises before anything is drawn
    write_figure(path, draw(maps, view, mount, blur_px, title), dpi=150)


def draw(maps: Sequence[ExposureMap], view: View, mount: Vehicle, blur_px: float, title: str) -> Figure:
    """Contours of the longest exposure on the picture plane, a panel for each map, and the shares within."""
    levels_ms = _levels(maps)
    columns = min(2, len(maps))
    rows = math.ceil((len(maps) + 1) / columns)  # the last panel for the shares
    tall = min(6.0, 7.6 / columns * view.height_px / view.width_px) + 0.55
    figure = Figure(figsize=(9.2, max(2.6, tall) * rows + 0.5), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    panels = [figure.add_subplot(grid[divmod(place, columns)]) for place in range(len(maps))]
    for axes, found in zip(panels, maps, strict=True):
        drawn = _panel(axes, found, mount, view, levels_ms)
    bar = figure.colorbar(drawn, ax=panels, ticks=levels_ms, pad=0.02, aspect=40)
    bar.ax.set_yticklabels([f"{level:g}" for level in levels_ms])
    bar.set_label(f"Longest exposure for {blur_px:g} px of motion blur / ms", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    row, column = divmod(len(maps), columns)
    _shares(figure.add_subplot(grid[row, column:]), maps, blur_px)
    figure.suptitle(plain(title), fontsize=10, parse_math=False)
    return figure


def _panel(
    axes: Axes, found: ExposureMap, mount: Vehicle, view: View, levels_ms: Sequence[float]
) -> ContourSet:
    x, y = found.pixels
    shown = np.ma.masked_invalid(np.clip(1e3 * found.longest_s, 0.999 * levels_ms[0], 1.001 * levels_ms[-1]))
    norm = BoundaryNorm(levels_ms, 256, extend="both")
    drawn = axes.contourf(x, y, shown, levels_ms, cmap=colormaps["viridis"], norm=norm, extend="both")
    crossed = [level for level in levels_ms if shown.min() < level < shown.max()]
    if crossed:
        lines = axes.contour(x, y, shown, crossed, colors="k", linewidths=0.7)
        axes.clabel(lines, fmt=lambda level: f"{level:g} ms", fontsize=7.5)
    road_m = mount.road_m(view.rays(found.pixels))
    sky = np.isinf(road_m)
    if sky.any() and not sky.all():
        axes.contour(x, y, sky, [0.5], colors="w", linewidths=1.2, linestyles="--")
        left = sky[:, 0]
        if left.any() and not left.all():
            _note(axes, "horizon", (0, y[int(left.sum()) - 1, 0]), (4, 3))
    axes.set_xlim(-0.5, view.width_px - 0.5)
    axes.set_ylim(view.height_px - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_title(found.scene, fontsize=9)
    axes.set_xlabel("x / px", fontsize=8)
    axes.set_ylabel("y / px", fontsize=8)
    axes.tick_params(labelsize=7.5)
    _mark_distances(axes, found, road_m, mount)
    return drawn


def _mark_distances(axes: Axes, found: ExposureMap, road_m: Floats, mount: Vehicle) -> None:
    """How far away the road is that is seen in the picture's middle column."""
    middle = road_m.shape[1] // 2
    seen = np.isfinite(road_m[:, middle]) & (road_m[:, middle] <= found.range_m[:, middle])
    x, y = found.pixels[:, seen, middle]
    level_m = np.sqrt(np.maximum(road_m[seen, middle] ** 2 - mount.height_m**2, 0.0))
    last = math.inf
    for distance_m in _ROAD_M:
        if not (level_m.size and level_m.min() <= distance_m <= level_m.max()):
            continue
        row = float(np.interp(-distance_m, -level_m, y))
        if last - row > 0.03 * road_m.shape[0] * (y[-1] - y[0]) / len(y):
            axes.plot(x[0], row, "_", color="w", ms=9)
            _note(axes, f"{distance_m} m", (x[0], row), (6, 0), "center")
            last = row


def _note(
    axes: Axes, text: str, at: tuple[float, float], offset_pt: tuple[float, float], va: str = "baseline"
) -> None:
    axes.annotate(text, at, xytext=offset_pt, textcoords="offset points", va=va, color="w", fontsize=7.5)


def _shares(axes: Axes, maps: Sequence[ExposureMap], blur_px: float) -> None:
    """Share of each scene that keeps within the limit, over the exposure."""
    shares = np.linspace(0.002, 1.0, 300)
    for number, found in enumerate(maps):
        times = np.array([found.at_share_s(share) for share in shares])
        shown = np.isfinite(times)
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(1e3 * times[shown], 100 * shares[shown], color=colour, label=found.scene)
        if shown.any():
            axes.set_xscale("log")
    axes.axhline(50, color="0.7", lw=0.8, ls=":")
    axes.set_ylim(0, 102)
    tidy(axes, x="Exposure / ms", y=f"Share within {blur_px:g} px / %")
    plain_numbers(axes.xaxis)
    axes.legend(fontsize=8, frameon=False)


def _levels(maps: Sequence[ExposureMap]) -> list[float]:
    """1, 2, 5, 10 ... ms around what the maps hold, at least two, at most twelve from the shortest on."""
    times = 1e3 * np.concatenate([found.longest_s[np.isfinite(found.longest_s)] for found in maps])
    if not times.size:
        return [1.0, 2.0]
    least, most = float(times.min()), float(np.quantile(times, 0.98))
    first_power = math.floor(math.log10(least))
    nice = [digit * 10.0**power for power in range(first_power, first_power + 6) for digit in (1, 2, 5)]
    first = max(0, sum(level <= least for level in nice) - 1)
    levels = [level for level in nice[first : first + _MOST_LEVELS] if level / 2.5 < most]
    return levels if len(levels) > 1 else nice[first : first + 2]
