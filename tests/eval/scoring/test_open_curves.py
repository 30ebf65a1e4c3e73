"""Curves of predicted means: what is not known of them widens intervals and what a choice may lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.grid.axes import SETTING
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.crossings import Curve
from blurnoise_eval.scoring.exposure_window import answers
from blurnoise_eval.scoring.surfaces import Surface

X = tuple((0.001 * 2.0 ** np.linspace(0, 6, 13)).tolist())
_DRAWN = np.random.default_rng(3).uniform(-0.2, 0.2, (30, 1)) + np.linspace(0.4, 0.8, 13)
OPEN = 0.02**2 * np.exp(-np.abs(np.subtract.outer(np.arange(13), np.arange(13))) / 4)


def curve(not_known: np.ndarray | None) -> Curve:  # type: ignore[type-arg]
    return Curve(X, _DRAWN, np.ones_like(_DRAWN), logarithmic=True, open=not_known)


def test_half_widths_add_as_squares() -> None:
    known, unsure = curve(None).interval(), curve(OPEN).interval()
    assert known is not None
    assert unsure is not None
    mean = curve(None).mean
    for one, other in zip(known, unsure, strict=True):
        assert np.abs(other - mean) == pytest.approx(np.hypot(one - mean, 1.96 * 0.02))


def test_where_nothing_is_open_it_is_as_measured() -> None:
    """But for steps between the values, which what is predicted does without."""
    measured, predicted = curve(None), curve(np.zeros((13, 13)))
    for one, other in zip(measured.interval() or (), predicted.interval() or (), strict=True):
        assert other == pytest.approx(one)
    assert measured.crossed(0.6).windows == predicted.crossed(0.6).windows


def test_a_window_is_less_sure() -> None:
    sure = [curve(not_known).crossed(0.6).sure[0][0] for not_known in (None, OPEN)]
    possible = [curve(not_known).crossed(0.6).possible[0][0] for not_known in (None, OPEN)]
    assert sure[1] > sure[0]
    assert possible[1] < possible[0]


SETTING_VALUES = dict.fromkeys(SETTING, 0.0) | {
    "illuminance_lux": 50.0,
    "temperature_c": 25.0,
    "f_number": 1.4,
}


def test_regret_goes_by_what_is_open_of_differences() -> None:
    """What is off alike at every exposure changes no choice."""
    surface = Surface(
        "m", "g", (), X, ((0.0, 0.0),), tuple(map(str, range(30))), _DRAWN[:, :, None],
        np.ones((30, 13, 1)), np.zeros((13, 1)), 30, np.zeros((13, 1)),
    )  # fmt: skip
    noisy = np.random.default_rng(4).normal(0, 0.05, surface.sums.shape)
    surface = replace(
        surface, sums=surface.sums + noisy, setting=tuple(SETTING_VALUES[name] for name in SETTING)
    )

    def lost(not_known: np.ndarray | None) -> float:  # type: ignore[type-arg]
        opened = None if not_known is None else not_known[None]
        (answer,) = answers(replace(surface, open=opened), Criterion(0.6, kept=False))
        assert answer.regret_95 is not None
        return answer.regret_95

    assert lost(np.full((13, 13), 0.05**2)) == pytest.approx(lost(None))
    assert lost(0.05**2 * np.eye(13)) > lost(None) + 0.05


def test_bound_with_what_is_open_is_the_wider_of_both() -> None:
    away = np.random.default_rng(5).normal(0, 0.1, (40, 3))
    gain = np.zeros(3)
    without, some = (float(certainty.regret_bound(away, gain, sigma=sigma)) for sigma in (0.0, 0.1))
    error = away.std(axis=0, ddof=1).max() / np.sqrt(40)
    assert some / without == pytest.approx(np.hypot(error, 0.1) / error, rel=0.1)


def test_every_so_manyth_exposure() -> None:
    surface = Surface(
        "m", "g", (), X, ((0.0, 0.0),), ("a",), np.arange(13.0)[None, :, None], np.ones((1, 13, 1)),
        np.arange(13.0)[:, None], 1, np.arange(13.0)[:, None], open=OPEN[None],
    )  # fmt: skip
    some = surface.at(surface.exposures_s[::4])
    assert some.exposures_s == X[::4]
    assert some.sums[0, :, 0].tolist() == some.saturated[:, 0].tolist() == [0, 4, 8, 12]
    assert some.open is not None
    assert some.open[0] == pytest.approx(OPEN[::4, ::4])
