"""What a program's scores stand on, in sentences: where nothing was measured, and whether lux x seconds is one axis.

Domain: lux, s; scores in the criterion's unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise.light.lights import Light
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import LIGHT, milliseconds
from blurnoise_eval.program.by_speed import ALIKE_STOPS, BySpeed
from blurnoise_eval.program.held_back import LEAST, can_be_held_back
from blurnoise_eval.report.words import counted
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.system.tables import finite

_SAME_STOPS = 0.02  # on the plane: exposures are typed with three digits
_FEW = f"fewer than {LEAST} scores could be held back over so wide a gap"
Span = tuple[float, float]


def unmeasured(found: Sequence[BySpeed], lights: Sequence[Light]) -> list[str]:
    """Where nothing shows how wrong the scores between two lights or exposures are, if anywhere.

    found: of each kind of target. lights: the run's named ones.
    """
    names = {light.lux: f"{light.name}, " for light in lights}
    spans: dict[str, list[Span]] = {}
    for known in found:
        for dark, bright in known.unknown:
            which = f"{names.get(dark, '')}{names.get(bright, '')}"
            spans.setdefault(which + _why(known, dark, bright), []).append((dark, bright))
    notes = []
    if spans:
        texts = [
            f"between {', '.join(f'{low:.6g} and {high:.6g}' for low, high in _joined(those))} lux ({why})"
            for why, those in sorted(spans.items(), key=lambda item: item[1])
        ]
        notes.append(
            f"{', '.join(texts)} nothing was measured: exposures, gains and scores go from one light to the other, "
            "and intervals are as wide as the scores around differ"
        )
    if times := _joined(span for known in found for span in known.unknown_s):
        text = ", ".join(f"{milliseconds(low)} and {milliseconds(high)}" for low, high in times)
        notes.append(
            f"between {text} ms ({_FEW}) nothing was measured: scores go from one exposure to the other, and "
            "intervals are as wide as the scores around differ"
        )
    return notes


def _why(known: BySpeed, dark: float, bright: float) -> str:
    if known.kinds[dark] != known.kinds[bright]:
        return "of other spectrum or headlamps"
    return _FEW if {dark, bright} & {*can_be_held_back(known.kinds)} else "no third of their kind"


def _joined(spans: Iterable[Span]) -> list[Span]:
    """Those that touch or overlap as one, rising."""
    joined: list[Span] = []
    for low, high in sorted(spans):
        if joined and low <= joined[-1][1] * (1 + 1e-9):
            low, before = joined.pop()
            high = max(high, before)
        joined.append((low, high))
    return joined


class OneAxis(NamedTuple):
    """How far scores differ at equal lux x seconds and motion in px, at different lights.

    pairs: of conditions. difference: the largest, brighter less darker light. low, high: its interval, at 95 % with
    those of all pairs, paired by picture; None from few pictures.
    """

    pairs: int
    difference: float | None = None
    low: float | None = None
    high: float | None = None

    @classmethod
    def of(cls, tables: Iterable[ScoreTable]) -> OneAxis:
        """The largest of all tables, each a kind of target.

        >>> OneAxis.of([])
        OneAxis(pairs=0, difference=None, low=None, high=None)
        """
        found: list[tuple[float, NDArray[np.float64]]] = []
        for table in tables:
            lit = table.take(table.measured & (table.conditions[LIGHT.name] > 0))
            for dark, bright in _pairs(lit):
                found.append(
                    (lit.mean[bright] - lit.mean[dark], lit.influence[:, bright] - lit.influence[:, dark])
                )
        if not found:
            return cls(0)
        difference, influence = max(found, key=lambda each: abs(each[0]))
        low, high = uncertainty.of_difference(difference, influence, 1 - 0.05 / len(found))
        return cls(len(found), float(difference), finite(float(low)), finite(float(high)))

    @property
    def text(self) -> str:
        """One sentence."""
        start = "scores are read off lux x seconds and motion in px"
        if self.difference is None:
            return f"{start}, by the camera's figures: the run has no equal ones at two lights, which would show it"
        within = ""
        if self.low is not None and self.high is not None:
            within = f" ({self.low:.3f} to {self.high:.3f}, 95 % for all pairs)"
        equal = f"{counted(self.pairs, 'pair')} of equal ones at two lights"
        return f"{start}: in {equal} they differ by {abs(self.difference):.3f} at most{within}"


def _pairs(lit: ScoreTable) -> NDArray[np.int64]:
    """(P, 2) conditions at one place of the plane, that in the darker light first."""
    from scipy.spatial import KDTree  # takes 0.2 s

    light = lit.conditions[LIGHT.name]
    pairs = KDTree(lit.places).query_pairs(_SAME_STOPS, p=np.inf, output_type="ndarray").reshape(-1, 2)
    pairs = np.take_along_axis(pairs, np.argsort(light[pairs], axis=1), axis=1)
    return np.asarray(pairs[light[pairs[:, 1]] > light[pairs[:, 0]] * 2**ALIKE_STOPS])
