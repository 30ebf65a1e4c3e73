"""Which image-quality metric ranks the conditions of a run as its detectors do, and which metric misleads?

  blurnoise sweep -o run
  python examples/studies/which_metric.py run -o maps

The study exposes charts under the conditions of the run, and compares their metrics with the mean confidence in each
group of targets. It reads the run's targets.csv, results.csv and conditions.json; no detector runs.

Conditions of equal light on the sensor (lux seconds), equal motion during the exposure (px) and equal gain are one
experiment: a node. Each metric has a rank correlation (Spearman) with the confidence over all nodes at which both are
known, its 95 % interval from a jackknife over pictures, and the rank correlation along light alone and motion alone.
A metric misleads where it ranks right along one of them and not over both.

DIR/maps.csv has a row for each model, group and metric, DIR/nodes.csv the values behind it. For each model there is a
figure of the confidence over light and motion, for each of its groups one of the confidence over each metric.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from blurnoise_eval import SweepPlan
from blurnoise_eval.measure.charts import METRICS, measure
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from matplotlib.tri import Triangulation
from scipy.stats import spearmanr, t

from blurnoise import Camera

SETTINGS = ["temperature_c", "f_number", "defocus_radius_px"]
NODE = ["light_lux_s", "motion_x_px", "motion_y_px", "gain_db", "dark_s", *SETTINGS]
"""What makes a node. dark_s: the exposure where the camera has dark current, else 0."""
STILL_PX = 0.5
"""Motion below this is none, in figures and in lines of equal motion."""
FEWEST_NODES = 20
"""Nodes below which a metric has no rank: by chance alone the correlation has a deviation of 1/sqrt(19)."""
FEWEST_ON_LINE = 5
"""Nodes of equal light, or of equal motion, from which on they count as a line."""
FEWEST_PICTURES = 8
"""Pictures from which on a jackknife over them gives an interval."""
RIGHT, MISLEADS = 0.8, 0.2
"""Rank correlation from which a metric ranks right along one axis, and the loss over both that misleads."""
MOST_GROUPS = 3
"""Groups of a model in the figures: those with the most targets."""
TITLES = {metric.name: metric.title for metric in METRICS}


@dataclass(frozen=True)
class Rank:
    """A row of maps.csv: a metric, and how it ranks the nodes; NaN where that cannot be computed.

    known: share of the nodes at which the metric is available. along_light, along_motion: median rank correlation
    over lines on which the other is constant.
    """

    model: str
    group: str
    metric: str
    n_nodes: int
    known: float
    spearman: float = np.nan
    low: float = np.nan
    high: float = np.nan
    along_light: float = np.nan
    along_motion: float = np.nan

    def __str__(self) -> str:
        if np.isnan(self.spearman):
            return "cannot tell"
        interval = "" if np.isnan(self.low) else f" ({self.low:.2f} to {self.high:.2f})"
        return f"{self.spearman:.2f}{interval}"

    @property
    def surely(self) -> float:
        """The low end of the interval; without one the correlation itself."""
        return self.spearman if np.isnan(self.low) else self.low

    @property
    def along(self) -> tuple[float, str]:
        """The greater of its rank correlations along one axis, and that axis."""
        pairs = ((self.along_light, "light"), (self.along_motion, "motion"))
        return max(pairs, key=lambda pair: np.nan_to_num(pair[0], nan=-1.0))

    @property
    def lost(self) -> float:
        """What a metric that ranks right along one axis loses over both; 0 for any other."""
        value, _ = self.along
        return float(np.nan_to_num(value - self.spearman)) if value >= RIGHT else 0.0


def targets_of(run: Path) -> tuple[pandas.DataFrame, Camera]:
    """Each target under each condition with light, with its node; and the camera. Raises ``ValueError``."""
    about = json.loads((run / "conditions.json").read_text(encoding="utf-8"))
    (camera,) = about["cameras"]
    targets = pandas.read_csv(run / "targets.csv")
    cells = pandas.read_csv(run / "results.csv", usecols=["cell_id", "model", "applied_gain_db"])
    targets = targets[~targets["clean"]].merge(cells, on=["cell_id", "model"])
    straight = {"trajectory": about["trajectory"] is None, "captures": not camera["captures"]}
    straight |= {
        "moves": (targets["moves"] == "all").all(),
        "ego_speed_m_s": (targets["ego_speed_m_s"] == 0).all(),
    }
    if others := [name for name, usual in straight.items() if not usual]:
        raise ValueError(f"{others[0]}: charts need one straight motion of the whole picture, in one capture")
    targets["light_lux_s"] = targets["exposure_s"] * targets["illuminance_lux"]
    # A camera that sets its gain sets it for each picture: the mean over the pictures counts, to a tenth of a dB.
    of_condition = ["model", "exposure_s", "illuminance_lux", "velocity_x_px_s", "velocity_y_px_s", "gain_db"]
    gain = targets.fillna({"applied_gain_db": 0.0}).groupby(of_condition)["applied_gain_db"].transform("mean")
    targets["gain_db"] = gain.round(1)
    x, y = (targets["exposure_s"] * targets[f"velocity_{axis}_px_s"] for axis in "xy")
    turned = (x < 0) | ((x == 0) & (y < 0))  # there and back blur alike
    targets["motion_x_px"], targets["motion_y_px"] = x.mask(turned, -x), y.mask(turned, -y)
    targets["dark_s"] = targets["exposure_s"] if camera["dark_current_e_s"] else 0.0
    for name in NODE:
        targets[name] = targets[name].map(lambda value: float(f"{value:.6g}") + 0.0)
    targets = targets[targets["light_lux_s"] > 0]
    targets.attrs["axes"] = list(about["conditions"][0])
    return targets, Camera.from_dict(camera)


def measured(targets: pandas.DataFrame, camera: Camera) -> pandas.DataFrame:
    """Every metric at every node, NaN where it is not available."""
    first = targets.groupby(NODE).first()
    columns = ["exposure_s", "illuminance_lux", "velocity_x_px_s", "velocity_y_px_s", "gain_db"]
    columns += [name for name in SETTINGS if name in targets.attrs["axes"]]
    conditions = []
    for _, row in first.reset_index()[columns].iterrows():
        conditions += SweepPlan({name: (float(value),) for name, value in row.items()}).conditions()
    rows = measure(camera, conditions, threads=os.cpu_count() or 1)
    values = np.array([row.estimate.value for row in rows]).reshape(len(first), len(METRICS))
    return pandas.DataFrame(values, first.index, [metric.name for metric in METRICS])


def confidence(targets: pandas.DataFrame, nodes: pandas.Index) -> np.ndarray[Any, Any]:
    """(1 + P, N) mean confidence at the nodes, of all pictures and then without each of them; NaN: unknown."""
    by_picture = targets.groupby([*NODE, "image"])["confidence"]
    sums, counts = (
        part.unstack(fill_value=0.0).reindex(nodes, fill_value=0.0)
        for part in (by_picture.sum(), by_picture.count())
    )
    total, count = sums.sum(axis=1).to_numpy(), counts.sum(axis=1).to_numpy()
    with np.errstate(invalid="ignore", divide="ignore"):
        without = (total[:, None] - sums.to_numpy()) / (count[:, None] - counts.to_numpy())
        return np.vstack([total / count, without.T])


def places(nodes: pandas.Index) -> np.ndarray[Any, Any]:
    """Light and motion of the nodes in stops, (2, N)."""
    table = nodes.to_frame()
    motion_px = np.hypot(table["motion_x_px"], table["motion_y_px"]).clip(lower=STILL_PX)
    return np.log2(np.stack([table["light_lux_s"], motion_px])).round(6)


def rank(
    values: np.ndarray[Any, Any], scores: np.ndarray[Any, Any], place: np.ndarray[Any, Any]
) -> dict[str, float]:
    """How a metric (N,) ranks the nodes by their scores (1 + P, N), which stand at places (2, N)."""
    scored = np.isfinite(scores[0])
    known = scored & np.isfinite(values)
    row = {"n_nodes": int(scored.sum()), "known": known.sum() / max(scored.sum(), 1)}
    if known.sum() < FEWEST_NODES:
        return row
    m, (light, motion) = values[known], place[:, known]
    whole, *without = (_spearman(m, y[known]) for y in scores)
    row |= {"spearman": whole, "along_light": _along(m, scores[0][known], motion)}
    row |= {"along_motion": _along(m, scores[0][known], light)}
    if len(without) >= FEWEST_PICTURES:
        # Jackknife: Efron and Tibshirani, An Introduction to the Bootstrap (1993), eq. 11.5.
        n = len(without)
        error = np.sqrt((n - 1) / n * np.sum((np.array(without) - np.mean(without)) ** 2))
        reach = t.ppf(0.975, n - 1) * error
        row |= {"low": max(whole - reach, -1.0), "high": min(whole + reach, 1.0)}
    return row


def _spearman(m: np.ndarray[Any, Any], y: np.ndarray[Any, Any]) -> float:
    both = np.isfinite(m) & np.isfinite(y)
    if both.sum() < 2 or np.ptp(m[both]) == 0 or np.ptp(y[both]) == 0:
        return float("nan")
    return float(spearmanr(m[both], y[both]).statistic)


def _along(m: np.ndarray[Any, Any], y: np.ndarray[Any, Any], constant: np.ndarray[Any, Any]) -> float:
    """Median rank correlation over lines on which ``constant`` has one value; NaN without such lines."""
    lines = (constant == value for value in np.unique(constant))
    found = [_spearman(m[line], y[line]) for line in lines if line.sum() >= FEWEST_ON_LINE]
    finite = [value for value in found if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")


def sentence(ranks: Sequence[Rank]) -> str:
    """The metric that ranks best, by the low end of its interval, and the one that misleads most."""
    candidates = [row for row in ranks if np.isfinite(row.spearman) and row.known >= 0.5]
    if not candidates:
        return f"cannot tell which metric ranks conditions; none is known at {FEWEST_NODES} and half of the nodes."
    best = max(candidates, key=lambda row: row.surely)
    sure = "ranks conditions best" if best.surely > 0 else "is the best, but does not surely rank conditions"
    text = f"{TITLES[best.metric]} {sure} (rank correlation {best}; "
    text += f"available at {best.known:.0%} of {best.n_nodes} nodes)."
    worst = max(ranks, key=lambda row: row.lost)
    if worst.lost >= MISLEADS:
        value, axis = worst.along
        text += f" {TITLES[worst.metric]} misleads: {value:.2f} along {axis} alone, {worst.spearman:.2f} over both."
    return text


def draw_map(
    groups: dict[str, np.ndarray[Any, Any]], place: np.ndarray[Any, Any], title: str, path: Path
) -> None:
    """The confidence over light and motion, a panel for each group; nodes at one place as their mean."""
    figure = Figure(figsize=(3.6 * len(groups) + 0.9, 3.7), layout="constrained")
    colour = Normalize(0, 1)
    for axes, (group, score) in zip(
        figure.subplots(1, len(groups), squeeze=False)[0], groups.items(), strict=True
    ):
        known = np.isfinite(score)
        at, which = np.unique(place[:, known], axis=1, return_inverse=True)
        mean = np.bincount(which.ravel(), score[known]) / np.bincount(which.ravel())
        x, y = 2.0**at
        if (
            np.linalg.matrix_rank(at - at.mean(axis=1, keepdims=True), tol=1e-6) == 2
        ):  # else all are on one line
            triangles = Triangulation(*at).triangles  # nearest in stops, as the axes are
            axes.tricontourf(
                Triangulation(x, y, triangles), mean, np.linspace(0, 1, 21), norm=colour, alpha=0.75
            )
        axes.scatter(x, y, s=16, c=mean, norm=colour, linewidths=0.4, edgecolors="black", zorder=3)
        axes.set(xscale="log", yscale="log", title=group, xlabel="Illuminance x exposure / lux s")
        axes.set_ylabel(f"Motion / px (at rest: {STILL_PX:g})")
    figure.colorbar(ScalarMappable(colour), ax=figure.axes, label="Mean confidence")
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)


def draw_scatter(
    score: np.ndarray[Any, Any],
    metrics: pandas.DataFrame,
    place: np.ndarray[Any, Any],
    ranks: Sequence[Rank],
    path: Path,
) -> None:
    """The confidence over each metric, a dot for each node in the colour of its motion."""
    figure, motion_px = Figure(figsize=(14, 10.4), layout="constrained"), 2.0 ** place[1]
    colour = LogNorm(motion_px.min(), max(motion_px.max(), 2 * motion_px.min()))
    for axes, metric, row in zip(
        figure.subplots(4, -(-len(METRICS) // 4)).flat, METRICS, ranks, strict=False
    ):
        values = metrics[metric.name].to_numpy()
        known = np.isfinite(score) & np.isfinite(values)
        if metric.scale == "log" and known.any() and values[known].min() > 0:
            spread = values[known].max() / values[known].min()
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 3) if spread < 300 else (1,)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_locator(NullLocator())
        axes.scatter(values[known], score[known], s=11, c=motion_px[known], norm=colour, cmap="plasma")
        axes.set_title(metric.label, fontsize=9)
        axes.set_ylim(-0.03, 1.27)
        axes.text(0.02, 0.98, f"rank: {row}", transform=axes.transAxes, fontsize=8, va="top")
    figure.supylabel("Mean confidence")
    figure.suptitle(f"{ranks[0].model}, {ranks[0].group}", fontsize=11)
    figure.colorbar(ScalarMappable(colour, "plasma"), ax=figure.axes, label="Motion / px", shrink=0.7)
    figure.savefig(path, dpi=110)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower()


def main(words: Sequence[str] | None = None) -> None:
    """Measure, rank, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results"
    )
    options = parser.parse_args(words)
    try:
        targets, camera = targets_of(options.run)
    except (OSError, ValueError) as error:
        parser.error(f"run = {str(options.run)!r}: {error}")
    options.output.mkdir(parents=True, exist_ok=True)
    metrics = measured(targets, camera)
    place = places(metrics.index)
    table, nodes = [], metrics.copy()
    for model, of_model in targets.groupby("model"):
        shown: dict[str, np.ndarray[Any, Any]] = {}
        for group in of_model["group"].value_counts().index:
            scores = confidence(of_model[of_model["group"] == group], metrics.index)
            ranks = [
                Rank(model, group, name, **rank(values.to_numpy(), scores, place))
                for name, values in metrics.items()
            ]
            table += ranks
            nodes[f"{model}: {group}: confidence"] = scores[0]
            if len(shown) < MOST_GROUPS:
                shown[group] = scores[0]
                print(f"{model}, {group}: {sentence(ranks)}")
                draw_scatter(
                    scores[0],
                    metrics,
                    place,
                    ranks,
                    options.output / f"scatter-{_slug(f'{model}-{group}')}.png",
                )
        draw_map(shown, place, f"{model}, {camera.name}", options.output / f"map-{_slug(model)}.png")
    ranks_table = pandas.DataFrame(table)
    ranks_table.to_csv(options.output / "maps.csv", index=False)
    nodes.reset_index().to_csv(options.output / "nodes.csv", index=False)
    print(ranks_table.pivot_table("spearman", "metric", ["model", "group"], sort=False).round(2).to_string())


if __name__ == "__main__":
    sys.exit(main())
