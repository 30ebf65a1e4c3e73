"""The closed-form predictor: a detector's score from camera, light and motion alone, no picture rendered.

Domain: scores as shares, those above 1 taken for 1. log(y/(1 - y)) = c0 + c1 s + c2 s^2 + c3 r + c4 r^2 + c5 b with

    s = log2 (0.62 E / sqrt(0.3 E + read^2 + dark + 1/(12 K^2))), E the electrons of a white pixel
    r = L/size, motion during the exposure by the mean side of the targets
    b = log2 (1 + (E/E_sat)^2), E_sat the electrons at which white saturates

fitted to the nodes by penalised fractional logistic regression (Papke and Wooldridge, J. Appl. Econometrics 11
(1996) 619; the penalty a normal prior of deviation ``PRIOR`` on the coefficients of standardised features). It
prescreens: a window's ends are where the score passes a level, often on a plateau, and :func:`edges` says how far
off it is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.answers.curves import windows
from blurnoise_eval.maps.nodes import Array, Plane
from blurnoise_eval.maps.ranking import FEWEST_NODES, Mask, auc, blocks, held_out_r2
from blurnoise_eval.maps.scored import NodeScores

NAMES = ("1", "s", "s^2", "L/size", "(L/size)^2", "log2(1 + (E/E_sat)^2)")
PRIOR = 10.0
FEWEST_ON_LINE = 4
"""Exposures from which on a line has windows to compare."""
_STEPS, _CLOSE = 100, 1e-10


class Edges(NamedTuple):
    """Ends of windows on the run's lines, the exposures of one light and velocity.

    measured: how many there are, between tested exposures. missed: those where the predictor has none of the kind on
    that line. off_stops: median distance of the others, None without any.
    """

    lines: int
    measured: int
    missed: int
    off_stops: float | None


@dataclass(frozen=True, eq=False)
class Predictor:
    """Six coefficients for a model, group and score; where they were fitted, and how well they predict.

    r2_h, r2_l, rms_h, rms_l: of blocks of light, or of blur, that it was not fitted to. auc: of telling nodes that
    keep the level, of the same. Ranges: (least, most) of the nodes.
    """

    scores: NodeScores
    coefficients: Array
    n_nodes: int
    ranges: dict[str, tuple[float, float]]
    r2_h: float | None
    r2_l: float | None
    rms_h: float | None
    rms_l: float | None
    auc: float | None
    edges: Edges

    def record(self) -> dict[str, Any]:
        """As plain values for JSON."""
        of = self.scores
        return {
            "model": of.model,
            "group": of.group,
            "score": of.score,
            "size_px": of.size_px,
            "clean": of.clean,
            "level": of.level,
            "coefficients": dict(zip(NAMES, self.coefficients.tolist(), strict=True)),
            "n_nodes": self.n_nodes,
            "ranges": self.ranges,
            "held_out": {name: getattr(self, name) for name in ("r2_h", "r2_l", "rms_h", "rms_l", "auc")},
            "as_a_window": self.edges._asdict(),
        }


def predictor_of(plane: Plane, scores: NodeScores) -> Predictor | None:
    """The predictor of a score; None below ``FEWEST_NODES`` nodes, or where the score is the same at all of them."""
    told = scores.told
    y = np.clip(scores.values[told], 0.0, 1.0)
    if told.sum() < FEWEST_NODES or np.ptp(y) == 0:
        return None
    x = features(plane, scores.size_px)
    coefficients = fit(x[told], y)
    by_light, by_blur = (held_out(x[told], y, blocks(along[told])) for along in (plane.u, plane.w))
    ranges = {
        "light_lux_s": [node.light_lux_s for node in plane.nodes],
        "L/size": x[:, 3],
        "s": x[:, 1],
        "E/E_sat": [node.white_share for node in plane.nodes],
    }
    rms_h, rms_l = (
        None if each is None else float(np.sqrt(np.mean((y - each) ** 2))) for each in (by_light, by_blur)
    )
    return Predictor(
        scores,
        coefficients,
        int(told.sum()),
        {name: _range(np.asarray(values)[told]) for name, values in ranges.items()},
        held_out_r2(y, by_light),
        held_out_r2(y, by_blur),
        rms_h,
        rms_l,
        None if by_light is None else auc(by_light, scores.values[told] >= scores.level),
        edges(plane, scores.values, predicted(x, coefficients), scores.level),
    )


def features(plane: Plane, size_px: float) -> Array:
    """(N, 6) at the nodes, in the order of ``NAMES``."""
    s = np.array([node.snr_log2 for node in plane.nodes], float)
    r = np.array([node.blur_px for node in plane.nodes], float) / size_px
    b = np.log2(1 + np.array([node.white_share for node in plane.nodes], float) ** 2)
    return np.stack([np.ones_like(s), s, s**2, r, r**2, b], axis=1)


def predicted(x: Array, coefficients: Array) -> Array:
    """The score that the coefficients (6,) give for features (N, 6)."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x @ coefficients, -500, 500))))


def fit(x: Array, y: Array, prior: float = PRIOR) -> Array:
    """Coefficients (6,) for features (N, 6), of which the first is 1, and shares y (N,); Newton's steps.

    A feature that is the same everywhere has the coefficient 0.
    """
    mean, scale = x.mean(axis=0), x.std(axis=0)
    mean[0], varies = 0.0, scale > 1e-12
    scale = np.where(varies, scale, 1.0)
    z = (x - mean) / scale
    z[:, 1:] *= varies[1:]
    penalty = np.full(x.shape[1], prior**-2)
    penalty[0] = 1e-9
    beta = np.zeros(x.shape[1])
    loss = _loss(z, y, beta, penalty)
    for _ in range(_STEPS):
        p = predicted(z, beta)
        slope = z.T @ (p - y) + penalty * beta
        curved = (z * (p * (1 - p))[:, None]).T @ z + np.diag(penalty)
        step = np.linalg.solve(curved, slope)
        share = 1.0
        while (then := _loss(z, y, beta - share * step, penalty)) > loss and share > 1e-6:
            share /= 2
        beta, gained, loss = beta - share * step, loss - then, then
        if gained < _CLOSE * max(1.0, abs(loss)):
            break
    found = beta / scale
    found[1:] *= varies[1:]
    found[0] = beta[0] - (found[1:] * mean[1:]).sum()
    return np.asarray(found)


def _loss(z: Array, y: Array, beta: Array, penalty: Array) -> float:
    at = z @ beta
    return float((np.logaddexp(0, at) - y * at).sum() + (penalty * beta**2).sum() / 2)


def held_out(x: Array, y: Array, held: Sequence[Mask]) -> Array | None:
    """What the fit to the other blocks says of each block's nodes, (N,); None for fewer than two blocks."""
    if len(held) < 2:
        return None
    told = np.empty_like(y)
    for block in held:
        told[block] = predicted(x[block], fit(x[~block], y[~block]))
    return told


def edges(plane: Plane, measured: Array, told: Array, level: float) -> Edges:
    """Where the measured and the predicted score (N,) pass the level on the run's lines."""
    lines, missed, off = 0, 0, []
    for exposures_s, nodes in plane.lines:
        known = np.isfinite(measured[nodes])
        if known.sum() < FEWEST_ON_LINE:
            continue
        lines += 1
        s = exposures_s[known].tolist()
        own, other = (_ends(s, values[nodes][known].tolist(), level) for values in (measured, told))
        for kind, at in own:
            apart = [abs(np.log2(at / there)) for same, there in other if same == kind]
            if apart:
                off.append(min(apart))
            else:
                missed += 1
    return Edges(lines, missed + len(off), missed, float(np.median(off)) if off else None)


def _ends(exposures_s: list[float], values: list[float], level: float) -> list[tuple[str, float]]:
    """Begins and ends of windows, s, but those at the ends of what was tested."""
    found = []
    for begin, end in windows(exposures_s, values, level):
        found += [("begins", begin)] if begin > exposures_s[0] else []
        found += [("ends", end)] if end < exposures_s[-1] else []
    return found


def _range(values: Array) -> tuple[float, float]:
    return float(values.min()), float(values.max())
