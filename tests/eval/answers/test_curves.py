"""Curves of a group of targets: what belongs together, how sure the mean is, where it fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.grid.axes import SETTING
from blurnoise_eval.scoring import uncertainty
from hypothesis import given
from hypothesis import strategies as st
from made_runs import failure_point
from made_tables import Named, endurances, endurances_across, over, tables
from plans import OWN

EXPOSURES_S = (0.01, 0.02, 0.04)
SPEEDS_PX_S = (0.0, 100.0, 400.0)


def rows(
    confidence: Callable[[str, int, float, float], float | None],
    *,
    images: int = 4,
    repeats: int = 1,
    velocities: tuple[tuple[float, float], ...] = tuple((speed, 0.0) for speed in SPEEDS_PX_S),
    exposures: tuple[float, ...] = EXPOSURES_S,
    **fields: Any,
) -> list[dict[str, Any]]:
    """Rows of one table; ``confidence`` of (image, repeat, exposure, speed), None where not measured."""
    shared = {"model": "m", "group": "g", "illuminance_lux": 50.0, "target_id": 0, **OWN, **fields}
    return [
        {**shared, "image": f"p{i}", "repeat": r, "exposure_s": t, "confidence": value}
        | {"velocity_x_px_s": x, "velocity_y_px_s": y}
        for i in range(images)
        for r in range(repeats)
        for t in exposures
        for x, y in velocities
        if (value := confidence(f"p{i}", r, t, float(np.hypot(x, y)))) is not None
    ]


def ends_of(values: np.ndarray) -> uncertainty.Ends:
    """The interval of the mean of values in [0, 1], one a picture."""
    return uncertainty.of_level(values.mean(), values - values.mean())


def by_axis(found: list[Named]) -> dict[tuple[str, float], Named]:
    held = {"exposure_s": "velocity_x_px_s", "blur_px": "exposure_s"}
    return {(each.axis, each.at[held[each.axis]] or 0.0): each for each in found}


def test_rows_become_one_table_per_model_and_group() -> None:
    every = [
        *rows(lambda *_: 0.5, model="a"),
        *rows(lambda *_: 0.6, model="a", illuminance_lux=100.0),
        *rows(lambda *_: 0.65, model="a", illuminance_lux=100.0, gain_db=6.0),
        *rows(lambda *_: 0.7, model="a", group="h"),
        *rows(lambda *_: 0.8, model="b"),
    ]
    found = list(tables(every))
    assert [(each.model, each.group, len(each)) for each in found] == [
        ("a", "g", 27),
        ("a", "h", 9),
        ("b", "g", 9),
    ]
    settings = list(found[0].split(SETTING))
    assert [float(each.mean[0]) for each in settings] == pytest.approx([0.5, 0.6, 0.65])
    assert [(each.at(0)["illuminance_lux"], each.at(0)["gain_db"]) for each in settings] == [
        (50, 0), (100, 0), (100, 6)
    ]  # fmt: skip
    assert settings[0].sums.shape == (4, 9)


def test_means_leave_out_what_was_not_measured() -> None:
    def some(image: str, _: int, exposure_s: float, speed: float) -> float | None:
        if exposure_s == 0.04 and speed == 400.0:
            return None
        return None if image == "p0" and speed == 100.0 else {"p0": 1.0, "p1": 0.4}.get(image, 0.1)

    (table,) = tables(rows(some))
    mean = over(table, table.mean)
    assert np.isnan(mean[2, 2])
    assert mean[0] == pytest.approx([1.6 / 4, 0.6 / 3, 1.6 / 4])
    found = by_axis(list(endurances(table, Criterion(0.6, kept=False))))
    assert found["exposure_s", 400.0].x == (0.01, 0.02)
    assert found["blur_px", 0.04].x == (0.0, 4.0)


def test_a_picture_is_one_cluster_with_its_targets_and_noise_fields() -> None:
    both = [row for target in (0, 1) for row in rows(lambda *_: 0.5, images=9, repeats=3, target_id=target)]
    (table,) = tables(both)
    assert table.sums.shape == (9, 9)
    assert (table.counts == 6).all()
    assert table.n_targets == 9 * 6
    (table,) = tables(both, cluster_of=lambda picture: "even" if int(picture[1:]) % 2 == 0 else "odd")
    assert table.clusters == ("even", "odd")
    assert table.counts[:, 0].tolist() == [5 * 6, 4 * 6]


def test_saturated_shares_are_means_over_what_was_measured() -> None:
    pictures = [row | {"saturated": 0.1 * int(row["image"][1:])} for row in rows(lambda *_: 0.5)]
    (table,) = tables(pictures)
    assert table.saturated == pytest.approx(np.full(9, 0.15))
    (unknown,) = tables(rows(lambda *_: 0.5))
    assert np.isnan(unknown.saturated).all()


def test_intervals_are_those_of_pictures_not_of_repeats() -> None:
    """Pictures of values v, five alike repeats each: Student's interval of the 40 within a few per cent.

    Were each repeat a sample of its own, it would be sqrt(5) = 2.2 times narrower.
    """
    values = {f"p{i}": float(v) for i, v in enumerate(np.random.default_rng(0).uniform(0, 1, 40))}
    (table,) = tables(rows(lambda image, *_: values[image], images=40, repeats=5))
    curve = next(endurances(table, Criterion(0.6, kept=False)))
    width = 2 * 2.0227 * np.std(list(values.values()), ddof=1) / np.sqrt(40)  # t of 39
    assert curve.auc_low is not None
    assert curve.auc_high is not None
    assert 0.96 * width <= curve.auc_high - curve.auc_low <= 1.2 * width
    assert (curve.n_pictures, curve.few_pictures) == (40, False)


def test_area_and_failure_of_a_straight_line() -> None:
    """Confidence 1 - blur / 20 px: at 40 ms and 0 to 16 px its mean is 0.6 and it crosses 0.7 at 6 px."""
    speeds = (0.0, 100.0, 200.0, 400.0)
    (table,) = tables(
        rows(
            lambda _i, _r, t, v: 1 - t * v / 20, velocities=tuple((v, 0.0) for v in speeds), exposures=(0.04,)
        )
    )
    (curve,) = endurances(table, Criterion(0.7, kept=False))
    assert (curve.axis, curve.at["exposure_s"]) == ("blur_px", 0.04)
    assert curve.at["velocity_x_px_s"] is None
    assert curve.x == pytest.approx((0, 4, 8, 16))
    assert curve.auc == pytest.approx(0.6)
    assert curve.fails_at == pytest.approx(6)
    assert (curve.fails_low, curve.fails_high, curve.auc_low) == (None, None, None)  # four pictures
    assert (curve.n_pictures, curve.few_pictures) == (4, True)
    assert not curve.non_monotonic


def test_a_curve_that_comes_back_is_told() -> None:
    """The real one of a detector that rises before it falls, and one that falls and comes back."""
    known = dict(zip((0.0, 100.0, 200.0, 400.0), (0.68, 0.3, 0.76, 0.2), strict=True))
    velocities = tuple((v, 0.0) for v in known)
    (table,) = tables(rows(lambda _i, _r, _t, v: known[v], velocities=velocities, exposures=(0.1,)))
    (curve,) = endurances(table, Criterion(0.6, kept=False))
    assert curve.non_monotonic
    assert curve.fails_at == pytest.approx(20 + 20 * 0.16 / 0.56)


def test_directions_of_one_speed_are_one_point_of_blur() -> None:
    velocities = ((-100.0, 0.0), (0.0, 100.0), (0.0, 0.0), (300.0, 400.0))
    per = dict(zip(velocities, (0.2, 0.6, 0.9, 0.1), strict=True))
    turned = [
        {**row, "confidence": per[row["velocity_x_px_s"], row["velocity_y_px_s"]]}
        for row in rows(lambda *_: 0.0, velocities=velocities, exposures=(0.02,))
    ]
    (table,) = tables(turned)
    (curve,) = endurances(table, Criterion(0.6, kept=False))
    assert curve.x == pytest.approx((0, 2, 10))
    assert curve.confidence == pytest.approx((0.9, 0.4, 0.1))


@given(st.lists(st.floats(0, 1), min_size=2, max_size=6), st.sampled_from([0.3, 0.5, 0.6]))
def test_interval_of_equal_pictures_is_the_failure_point(values: list[float], threshold: float) -> None:
    """Eight equal pictures leave in doubt only what none showed, q as in the crossings' tests: the curve fails for
    good between where (1 - q) m and where q + (1 - q) m do."""
    speeds = tuple((100.0 * place, 0.0) for place in range(len(values)))
    (table,) = tables(
        rows(lambda _i, _r, _t, v: values[round(v / 100)], images=8, velocities=speeds, exposures=(0.01,))
    )
    (curve,) = endurances(table, Criterion(threshold, kept=False))
    point = failure_point([0.01 * v for v, _ in speeds], curve.confidence, threshold)
    assert curve.non_monotonic == point.returned
    assert curve.fails_at == (None if point.at is None else pytest.approx(point.at))
    q = float(ends_of(np.zeros(8)).high)
    ends = [[(1 - q) * value for value in values], [q + (1 - q) * value for value in values]]
    if min(abs(value - threshold) for end in ends for value in end) > 1e-6:  # else rounding decides
        expected = [failure_point([0.01 * v for v, _ in speeds], end, threshold).at for end in ends]
        for found, at in zip((curve.fails_low, curve.fails_high), expected, strict=True):
            assert found == (None if at is None else pytest.approx(at, abs=1e-6))


def across(
    values: dict[float, Callable[[str], float]], axis: str, threshold: float = 0.6, **options: Any
) -> list[Named]:
    """The curves over ``axis`` of a still chart at one exposure, a confidence of each picture per value."""
    one = {"exposures": (0.01,), "velocities": ((0.0, 0.0),)} | options
    table = [
        row
        for value, of in values.items()
        for row in rows(lambda image, *_, of=of: of(image), **one, **{axis: value})
    ]
    found = endurances_across(*tables(table), Criterion(threshold, kept=False))
    return list(map(Named, found))


@pytest.mark.parametrize("axis", ["illuminance_lux", "gain_db"])
def test_where_more_is_not_worse_there_is_no_failing(axis: str) -> None:
    assert across({1.0: lambda _: 0.9, 3.0: lambda _: 0.1}, axis) == []


def test_curves_over_an_axis_keep_everything_else_apart() -> None:
    """2 f-numbers x 2 lights x 2 exposures x 2 velocities: 8 curves over the f-number, none over light."""
    table = [
        row
        for n in (2.0, 4.0)
        for lux in (5.0, 50.0)
        for row in rows(
            lambda _i, _r, t, v, n=n, lux=lux: 1 / (n + lux + t + v), f_number=n, illuminance_lux=lux,
            exposures=(0.01, 0.02), velocities=((0.0, 0.0), (100.0, 0.0)),
        )
    ]  # fmt: skip
    found = list(endurances_across(*tables(table), Criterion(0.6, kept=False)))
    assert [each.axis for each in found] == ["f_number"] * 8
    for each in found:
        lux, t, v = (each.at[name] or 0.0 for name in ("illuminance_lux", "exposure_s", "velocity_x_px_s"))
        assert each.confidence == pytest.approx([1 / (n + lux + t + v) for n in (2.0, 4.0)])
