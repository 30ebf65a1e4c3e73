"""The closed-form predictor: a detector's score from camera, light and motion alone, no picture rendered.

Domain: scores as shares, those above 1 taken for 1. log(y/(1 - y)) = c0 + c1 s + c2 s^2 + c3 r + c4 r^2 + c5 b with

    s = log2 (0.62 E / sqrt(0.3 E + read^2 + dark + 1/(12 K^2))), E the electrons of a white pixel
    r = L/size, motion during the exposure by the mean side of the targets
    b = log2 (1 + (E/E_sat)^2), E_sat the electrons at which white saturates

fitted to the nodes by penalised fractional logistic regression (Papke and Wooldridge, J. Appl. Econometrics 11
(1996) 619; the penalty a normal prior of deviation ``PRIOR`` on the coefficients of standardised features). The ends
of windows, where the score passes a level, often lie on a plateau: :func:`edges` gives the error there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blurnoise_eval.answers.curves import windows
from blurnoise_eval.deciding.surface import fractional_logistic, logistic
from blurnoise_eval.maps.nodes import Array, Nodes, NodeScores
from blurnoise_eval.maps.ranking import FEWEST_NODES, Mask, auc, blocks, explained, held_out

FEATURES = {
    "1": "1",
    "s": "log2(0.62 E / sqrt(0.3 E + read^2 + dark + 1/(12 K^2))), E electrons of a white pixel",
    "s^2": "its square",
    "L/size": "motion during the exposure by the targets' mean side",
    "(L/size)^2": "its square",
    "log2(1 + (E/E_sat)^2)": "E_sat: electrons at which white saturates, at the gain",
}
"""Their names and meanings, as predictor.json has them."""
PRIOR = 10.0
FEWEST_ON_LINE = 4
"""Exposures from which on the windows of a line are compared."""


def predictor_of(nodes: Nodes, scores: NodeScores) -> dict[str, Any] | None:
    """The predictor of a score, as predictor.json has it; None below ``FEWEST_NODES`` nodes, or of equal scores.

    ranges: (least, most) of the nodes. held_out: of blocks of light (h), or of blur (l), that it was not fitted to;
    auc: of telling nodes that keep the level from the others. as_a_window: as of :func:`edges`.
    """
    known = scores.known
    measured = scores.values[known]
    y = np.clip(measured, 0.0, 1.0)
    if known.sum() < FEWEST_NODES or np.ptp(y) == 0:
        return None
    every, level = features(nodes, scores.size_px), scores.enough.level
    x, coefficients = every[known], fit(every[known], y)

    def predict(fitted: Mask, at: Mask) -> Array:
        return logistic(x[at] @ fit(x[fitted], y[fitted]))

    by_light, by_blur = (held_out(y, blocks(along), predict) for along in nodes.places[known].T)
    light_lux_s, white_share = (nodes.figures[name][known] for name in ("light_lux_s", "white_share"))
    ranges = {"light_lux_s": light_lux_s, "L/size": x[:, 3], "s": x[:, 1], "E/E_sat": white_share}
    return {
        "model": scores.table.model,
        "group": scores.table.group,
        "score": scores.enough.score,
        "size_px": scores.size_px,
        "clean": scores.table.clean,
        "level": level,
        "coefficients": dict(zip(FEATURES, coefficients.tolist(), strict=True)),
        "n_nodes": int(known.sum()),
        "ranges": {name: (float(values.min()), float(values.max())) for name, values in ranges.items()},
        "held_out": {
            "r2_h": explained(y, by_light),
            "r2_l": explained(y, by_blur),
            "rms_h": _rms(y, by_light),
            "rms_l": _rms(y, by_blur),
            "auc": None if by_light is None else auc(by_light, measured >= level),
        },
        "as_a_window": edges(nodes, scores.values, logistic(every @ coefficients), level),
    }


def features(nodes: Nodes, size_px: float) -> Array:
    """(N, 6) at the nodes, in the order of ``FEATURES``."""
    s, r = nodes.figures["snr_log2"], nodes.figures["blur_px"] / size_px
    over = np.log2(1 + nodes.figures["white_share"] ** 2)
    return np.stack([np.ones_like(s), s, s**2, r, r**2, over], axis=1)


def fit(x: Array, y: Array, prior: float = PRIOR) -> Array:
    """Coefficients (6,) for features (N, 6), of which the first is 1, and shares y (N,).

    A feature that is the same everywhere has the coefficient 0.
    """
    mean, scale = x.mean(axis=0), x.std(axis=0)
    varies = scale > 1e-12
    varies[0], mean[0] = True, 0.0
    scale = np.where(scale > 1e-12, scale, 1.0)
    penalty = np.full(x.shape[1], prior**-2)
    penalty[0] = 1e-9
    found = varies * fractional_logistic((x - mean) / scale * varies, y, penalty) / scale
    found[0] -= (found[1:] * mean[1:]).sum()
    return np.asarray(found)


def edges(nodes: Nodes, measured: Array, predicted: Array, level: float) -> dict[str, Any]:
    """Ends of windows, where the measured and the predicted score (N,) pass the level on the run's lines.

    measured: their number, between tested exposures. missed: those where the predictor has none of the kind on that
    line. off_stops: median distance of the others, None without any.
    """
    lines, missed, off = 0, 0, []
    for exposures_s, places in nodes.lines:
        known = np.isfinite(measured[places])
        if known.sum() < FEWEST_ON_LINE:
            continue
        lines += 1
        expected = _ends(exposures_s[known], predicted[places][known], level)
        for kind, at in _ends(exposures_s[known], measured[places][known], level):
            apart = [abs(math.log2(at / there)) for same, there in expected if same == kind]
            off += [min(apart)] if apart else []
            missed += not apart
    median = float(np.median(off)) if off else None
    return {"lines": lines, "measured": missed + len(off), "missed": missed, "off_stops": median}


def _ends(exposures_s: Array, values: Array, level: float) -> list[tuple[str, float]]:
    """Begins and ends of windows, s, except at the ends of the tested exposures."""
    found = []
    for begin, end in windows(exposures_s.tolist(), values.tolist(), level):
        found += [("begins", begin)] if begin > exposures_s[0] else []
        found += [("ends", end)] if end < exposures_s[-1] else []
    return found


def _rms(y: Array, predicted: Array | None) -> float | None:
    return None if predicted is None else float(np.sqrt(np.mean((y - predicted) ** 2)))
