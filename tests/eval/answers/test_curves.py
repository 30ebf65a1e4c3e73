"""Curves of a group of targets: what belongs together, how sure the mean is, where it fails."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.grid.axes import SETTING
from made_tables import endurances, endurances_across, over, tables
from plans import OWN

EXPOSURES_S = (0.01, 0.02, 0.04)
SPEEDS_PX_S = (0.0, 100.0, 400.0)
Velocities = tuple[tuple[float, float], ...]


def rows(
    confidence: Callable[[str, int, float, float], float | None] | float,
    *,
    images: int = 4,
    repeats: int = 1,
    velocities: Velocities = tuple((speed, 0.0) for speed in SPEEDS_PX_S),
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
        if (value := confidence(f"p{i}", r, t, float(np.hypot(x, y))) if callable(confidence) else confidence)
        is not None
    ]


def test_rows_become_one_table_per_model_and_group():
    every = [*rows(0.5, model="a"), *rows(0.6, model="a", illuminance_lux=100.0)]
    every += rows(0.65, model="a", illuminance_lux=100.0, gain_db=6.0)
    every += [*rows(0.7, model="a", group="h"), *rows(0.8, model="b")]
    found = list(tables(every))
    named = [(each.model, each.group, len(each)) for each in found]
    assert named == [("a", "g", 27), ("a", "h", 9), ("b", "g", 9)]
    settings = list(found[0].split(SETTING))
    assert [float(each.mean[0]) for each in settings] == pytest.approx([0.5, 0.6, 0.65])
    at = [(each.at(0)["illuminance_lux"], each.at(0)["gain_db"]) for each in settings]
    assert at == [(50, 0), (100, 0), (100, 6)]
    assert settings[0].sums.shape == (4, 9)


def test_means_leave_out_what_was_not_measured():
    def some(image: str, _: int, exposure_s: float, speed: float) -> float | None:
        if exposure_s == 0.04 and speed == 400.0:
            return None
        return None if image == "p0" and speed == 100.0 else {"p0": 1.0, "p1": 0.4}.get(image, 0.1)

    measured = [row | {"saturated": 0.1 * int(row["image"][1:])} for row in rows(some)]
    (table,) = tables(measured)
    mean = over(table, table.mean)
    assert np.isnan(mean[2, 2])
    assert mean[0] == pytest.approx([1.6 / 4, 0.6 / 3, 1.6 / 4])
    assert over(table, table.saturated)[0] == pytest.approx([0.15, 0.2, 0.15])
    found = list(endurances(table, Criterion(0.6, kept=False)))
    by_exposure = next(each for each in found if each.axis == "exposure_s" and each.velocity_x_px_s == 400.0)
    by_blur = next(each for each in found if each.axis == "blur_px" and each.exposure_s == 0.04)
    assert (by_exposure.x, by_blur.x) == ((0.01, 0.02), (0.0, 4.0))


def test_a_picture_is_one_cluster_with_its_targets_and_noise_fields():
    """Student's interval of 40 pictures within a few per cent; were each repeat a sample of its own, it would be
    sqrt(5) = 2.2 times narrower."""
    both = [row for target in (0, 1) for row in rows(0.5, images=9, repeats=3, target_id=target)]
    (table,) = tables(both)
    assert table.sums.shape == (9, 9)
    assert (table.counts == 6).all()
    assert table.n_targets == 9 * 6
    (table,) = tables(both, cluster_of=lambda picture: "even" if int(picture[1:]) % 2 == 0 else "odd")
    assert table.clusters == ("even", "odd")
    assert table.counts[:, 0].tolist() == [5 * 6, 4 * 6]
    values = {f"p{i}": float(v) for i, v in enumerate(np.random.default_rng(0).uniform(0, 1, 40))}
    (table,) = tables(rows(lambda image, *_: values[image], images=40, repeats=5))
    curve = next(endurances(table, Criterion(0.6, kept=False)))
    width = 2 * 2.0227 * np.std(list(values.values()), ddof=1) / np.sqrt(40)  # t of 39
    assert 0.96 * width <= curve.auc_high - curve.auc_low <= 1.2 * width
    assert (curve.n_pictures, curve.few_pictures) == (40, False)


def by_speed(values: dict[float, float], exposure_s: float, threshold: float) -> Any:
    """The curve over blur of a score at speeds."""
    velocities = tuple((v, 0.0) for v in values)
    (table,) = tables(rows(lambda _i, _r, _t, v: values[v], velocities=velocities, exposures=(exposure_s,)))
    (curve,) = endurances(table, Criterion(threshold, kept=False))
    return curve


def test_area_and_failure_of_a_straight_line():
    """Confidence 1 - blur / 20 px: at 40 ms and 0 to 16 px its mean is 0.6 and it crosses 0.7 at 6 px."""
    curve = by_speed({v: 1 - 0.04 * v / 20 for v in (0.0, 100.0, 200.0, 400.0)}, 0.04, 0.7)
    assert (curve.axis, curve.at["exposure_s"], curve.at["velocity_x_px_s"]) == ("blur_px", 0.04, None)
    assert curve.x == pytest.approx((0, 4, 8, 16))
    assert (curve.auc, curve.fails_at) == (pytest.approx(0.6), pytest.approx(6))
    assert (curve.fails_low, curve.fails_high, curve.auc_low) == (None, None, None)  # four pictures
    assert (curve.n_pictures, curve.few_pictures) == (4, True)
    assert not curve.non_monotonic


def test_directions_of_one_speed_are_one_point_of_blur():
    per = {(-100.0, 0.0): 0.2, (0.0, 100.0): 0.6, (0.0, 0.0): 0.9, (300.0, 400.0): 0.1}
    turned = [
        {**row, "confidence": per[row["velocity_x_px_s"], row["velocity_y_px_s"]]}
        for row in rows(0.0, velocities=tuple(per), exposures=(0.02,))
    ]
    (table,) = tables(turned)
    (curve,) = endurances(table, Criterion(0.6, kept=False))
    assert curve.x == pytest.approx((0, 2, 10))
    assert curve.confidence == pytest.approx((0.9, 0.4, 0.1))


def test_curves_over_an_axis_keep_everything_else_apart():
    """2 f-numbers x 2 lights x 2 exposures x 2 velocities: 8 curves over the f-number, none over light."""
    how: dict[str, Any] = {"exposures": (0.01, 0.02), "velocities": ((0.0, 0.0), (100.0, 0.0))}
    table = [
        row
        for n in (2.0, 4.0)
        for lux in (5.0, 50.0)
        for row in rows(
            lambda _i, _r, t, v, n=n, lux=lux: 1 / (n + lux + t + v), f_number=n, illuminance_lux=lux, **how
        )
    ]
    found = list(endurances_across(*tables(table), Criterion(0.6, kept=False)))
    assert [each.axis for each in found] == ["f_number"] * 8
    for each in found:
        others = sum(each.at[name] or 0.0 for name in ("illuminance_lux", "exposure_s", "velocity_x_px_s"))
        assert each.confidence == pytest.approx([1 / (n + others) for n in (2.0, 4.0)])
