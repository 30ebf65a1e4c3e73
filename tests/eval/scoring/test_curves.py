"""Curves of a group of targets: what belongs together, how sure the mean is, where it fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.grid.axes import SETTING
from blurnoise_eval.scoring.curves import (
    RESAMPLES,
    Endurance,
    endurances,
    endurances_across,
    mean_auc,
    surfaces,
)
from blurnoise_eval.scoring.matching import failure_point
from hypothesis import given
from hypothesis import strategies as st
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
    """Rows of one surface; ``confidence`` of (image, repeat, exposure, speed), None where not measured."""
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


def generator() -> np.random.Generator:
    return np.random.default_rng(1)


def by_axis(found: list[Endurance]) -> dict[tuple[str, float], Endurance]:
    held = {"exposure_s": "velocity_x_px_s", "blur_px": "exposure_s"}
    return {(each.axis, each.at[held[each.axis]] or 0.0): each for each in found}


def test_rows_become_one_surface_per_model_group_and_setting() -> None:
    table = [
        *rows(lambda *_: 0.5, model="a"),
        *rows(lambda *_: 0.6, model="a", illuminance_lux=100.0),
        *rows(lambda *_: 0.65, model="a", illuminance_lux=100.0, gain_db=6.0),
        *rows(lambda *_: 0.7, model="a", group="h"),
        *rows(lambda *_: 0.8, model="b"),
    ]
    found = list(surfaces(table))
    assert [(s.model, s.group, s.setting[0]) for s in found] == [
        ("a", "g", 50.0), ("a", "g", 100.0), ("a", "g", 100.0), ("a", "h", 50.0), ("b", "g", 50.0),
    ]  # fmt: skip
    assert [float(s.mean[0, 0]) for s in found] == pytest.approx([0.5, 0.6, 0.65, 0.7, 0.8])
    assert [dict(zip(SETTING, s.setting, strict=True))["gain_db"] for s in found] == [0, 0, 6, 0, 0]
    assert found[0].confidence.shape == (4, 3, 3)


def test_means_leave_out_what_was_not_measured() -> None:
    def some(image: str, _: int, exposure_s: float, speed: float) -> float | None:
        if exposure_s == 0.04 and speed == 400.0:
            return None
        return None if image == "p0" and speed == 100.0 else {"p0": 1.0, "p1": 0.4}.get(image, 0.1)

    (surface,) = surfaces(rows(some))
    assert np.isnan(surface.mean[2, 2])
    assert surface.mean[0] == pytest.approx([1.6 / 4, 0.6 / 3, 1.6 / 4])
    found = by_axis(list(endurances(surface, 0.6, generator())))
    assert found["exposure_s", 400.0].x == (0.01, 0.02)
    assert found["blur_px", 0.04].x == (0.0, 4.0)


@pytest.mark.parametrize(
    ("images", "repeats", "samples"), [(2, 1, None), (1, 2, None), (1, 3, 3), (2, 2, 4), (3, 1, 3), (3, 5, 3)]
)
def test_pictures_are_drawn_together_and_below_three_noise_fields(
    images: int, repeats: int, samples: int | None
) -> None:
    both = [
        row
        for target in (0, 1)
        for row in rows(lambda *_: 0.5, images=images, repeats=repeats, target_id=target)
    ]
    (surface,) = surfaces(both)
    drawn = surface.resampled(generator())
    if samples is None:
        assert drawn is None
    else:
        assert len(set(surface.sample.tolist())) == samples
        assert drawn is not None
        assert drawn.shape == (RESAMPLES, 3, 3)


def test_spread_of_drawn_means_is_that_of_pictures_not_of_repeats() -> None:
    """Pictures of values v, five alike repeats each: the mean's spread is std(v) / sqrt(pictures).

    400 draws know a standard deviation to 1 / sqrt(2 x 400) = 3.5 %: within 5 x 3.5 %. Were each repeat its
    own sample, it would be sqrt(5) = 2.2 times smaller.
    """
    values = {f"p{i}": float(v) for i, v in enumerate(np.random.default_rng(0).uniform(0, 1, 40))}
    (surface,) = surfaces(rows(lambda image, *_: values[image], images=40, repeats=5))
    drawn = surface.resampled(generator())
    assert drawn is not None
    expected = np.std(list(values.values())) / np.sqrt(40)
    assert drawn[:, 0, 0].std() == pytest.approx(expected, rel=0.18)
    # Points of a curve are drawn together: alike values stay alike.
    np.testing.assert_allclose(drawn, drawn[:, :1, :1] * np.ones((1, 3, 3)))


def test_area_and_failure_of_a_straight_line() -> None:
    """Confidence 1 - blur / 20 px: at 40 ms and 0 to 16 px its mean is 0.6 and it crosses 0.7 at 6 px."""
    speeds = (0.0, 100.0, 200.0, 400.0)
    (surface,) = surfaces(
        rows(
            lambda _i, _r, t, v: 1 - t * v / 20, velocities=tuple((v, 0.0) for v in speeds), exposures=(0.04,)
        )
    )
    (curve,) = endurances(surface, 0.7, generator())
    assert (curve.axis, curve.at["exposure_s"]) == ("blur_px", 0.04)
    assert curve.at["velocity_x_px_s"] is None
    assert curve.x == pytest.approx((0, 4, 8, 16))
    assert curve.auc == pytest.approx(0.6)
    assert (curve.fails_at, curve.fails_low, curve.fails_high) == pytest.approx((6, 6, 6))
    assert not curve.non_monotonic
    assert mean_auc([curve], "blur_px") == pytest.approx(0.6)
    assert mean_auc([curve], "exposure_s") is None


def test_interval_of_the_failure_point_is_that_of_its_pictures() -> None:
    """Picture i fails at 4 + i px, 0 to 8: a mean of 9 crossings, each 0 to 8 px from 4, lies in between.

    Every curve is 1 - (x - crossing) / 20 at threshold 1, so the mean's crossing is the mean crossing, 8, with
    a bootstrap spread of sqrt(60 / 9) / 3 = 0.86: 95 % within 8 -+ 1.69, each end known to 0.12 x 5.
    """
    speeds = tuple((100.0 * v, 0.0) for v in range(5))
    (surface,) = surfaces(
        rows(
            lambda image, _r, t, v: 1 - (t * v - 4 - int(image[1:])) / 20,
            images=9, velocities=speeds, exposures=(0.04,),
        )
    )  # fmt: skip
    (curve,) = endurances(surface, 1.0, generator())
    assert curve.fails_at == pytest.approx(8)
    assert curve.fails_low == pytest.approx(8 - 1.69, abs=0.6)
    assert curve.fails_high == pytest.approx(8 + 1.69, abs=0.6)


def test_a_curve_that_holds_has_no_failure_and_an_open_interval() -> None:
    (surface,) = surfaces(rows(lambda *_: 0.9))
    for curve in endurances(surface, 0.6, generator()):
        assert (curve.fails_at, curve.fails_low, curve.fails_high) == (None, None, None)


def test_a_curve_that_comes_back_is_told() -> None:
    """The real one of a detector that rises before it falls, and one that falls and comes back."""
    table = dict(zip((0.0, 100.0, 200.0, 400.0), (0.68, 0.3, 0.76, 0.2), strict=True))
    velocities = tuple((v, 0.0) for v in table)
    (surface,) = surfaces(rows(lambda _i, _r, _t, v: table[v], velocities=velocities, exposures=(0.1,)))
    (curve,) = endurances(surface, 0.6, generator())
    assert curve.non_monotonic
    assert curve.fails_at == pytest.approx(20 + 20 * 0.16 / 0.56)


def test_directions_of_one_speed_are_one_point_of_blur() -> None:
    velocities = ((-100.0, 0.0), (0.0, 100.0), (0.0, 0.0), (300.0, 400.0))
    per = dict(zip(velocities, (0.2, 0.6, 0.9, 0.1), strict=True))
    table = [
        {**row, "confidence": per[row["velocity_x_px_s"], row["velocity_y_px_s"]]}
        for row in rows(lambda *_: 0.0, velocities=velocities, exposures=(0.02,))
    ]
    (surface,) = surfaces(table)
    (curve,) = endurances(surface, 0.6, generator())
    assert curve.x == pytest.approx((0, 2, 10))
    assert curve.confidence == pytest.approx((0.9, 0.4, 0.1))


@given(st.lists(st.floats(0, 1), min_size=2, max_size=6), st.sampled_from([0.3, 0.5, 0.6]))
def test_interval_of_equal_pictures_is_the_failure_point(values: list[float], threshold: float) -> None:
    """Every draw of equal pictures is the curve itself, so both ends are its failure point."""
    speeds = tuple((100.0 * place, 0.0) for place in range(len(values)))
    (surface,) = surfaces(
        rows(lambda _i, _r, _t, v: values[round(v / 100)], velocities=speeds, exposures=(0.01,))
    )
    (curve,) = endurances(surface, threshold, generator())
    point = failure_point([0.01 * v for v, _ in speeds], curve.confidence, threshold)
    assert (curve.fails_at, curve.non_monotonic) == point
    margin = min(abs(value - threshold) for value in values)
    if margin > 1e-9:  # else rounding decides
        ends = (None, None) if point.at is None else pytest.approx((point.at, point.at))
        assert (curve.fails_low, curve.fails_high) == ends


def across(
    values: dict[float, Callable[[str], float]], axis: str, threshold: float = 0.6, **options: Any
) -> list[Endurance]:
    """The curves over ``axis`` of a still chart at one exposure, a confidence of each picture per value."""
    one = {"exposures": (0.01,), "velocities": ((0.0, 0.0),)} | options
    table = [
        row
        for value, of in values.items()
        for row in rows(lambda image, *_, of=of: of(image), **one, **{axis: value})
    ]
    return list(endurances_across(list(surfaces(table)), threshold, generator()))


def test_a_curve_over_a_further_axis_fails_where_its_mean_does() -> None:
    """Confidence 1 - defocus / 10 px in all pictures alike: it crosses 0.6 at 4 px, and so does every draw."""
    (curve,) = across({r: lambda _, r=r: 1 - r / 10 for r in (0.0, 2.0, 8.0)}, "defocus_radius_px")  # type: ignore[misc]
    assert curve.axis == "defocus_radius_px"
    assert curve.x == (0.0, 2.0, 8.0)
    assert (curve.at["defocus_radius_px"], curve.at["exposure_s"], curve.at["illuminance_lux"]) == (
        None,
        0.01,
        50,
    )
    assert curve.auc == pytest.approx(0.6)
    assert (curve.fails_at, curve.fails_low, curve.fails_high) == pytest.approx((4, 4, 4))
    assert list(curve.row())[:5] == ["model", "group", "illuminance_lux", "axis", "exposure_s"]


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
    found = list(endurances_across(list(surfaces(table)), 0.6, generator()))
    assert [each.axis for each in found] == ["f_number"] * 8
    for each in found:
        lux, t, v = (each.at[name] or 0.0 for name in ("illuminance_lux", "exposure_s", "velocity_x_px_s"))
        assert each.confidence == pytest.approx([1 / (n + lux + t + v) for n in (2.0, 4.0)])


def test_draws_across_settings_are_paired_whatever_the_order_of_rows() -> None:
    """Pictures of 0.5 -+ d that lose 0.2 over the axis, all alike: from one draw to the next the whole curve moves
    up and down, and each draw crosses the mean of the two ends, shifted by the draw's own mean: between
    0.6 - 0.4 and 0.6 + 0.4 of the way. Were the ends drawn apart, some draws would not cross at all."""
    shift = {"p0": -0.1, "p1": 0.1, "p2": -0.05, "p3": 0.05, "p4": 0.0}

    def line(drop: float) -> Callable[[str], float]:
        return lambda image: 0.7 + 0.5 * shift[image] - drop

    values = {0.0: line(0.0), 10.0: line(0.2)}
    table = [
        row
        for value, of in values.items()
        for row in rows(
            lambda image, *_, of=of: of(image), images=5, exposures=(0.01,), velocities=((0.0, 0.0),),
            defocus_radius_px=value,
        )
    ]  # fmt: skip
    turned = [*table[:5], *table[:4:-1]]  # the second setting's pictures arrive in another order
    straight, other = (list(endurances_across(list(surfaces(t)), 0.6, generator())) for t in (table, turned))
    assert straight == other
    (curve,) = straight
    assert curve.fails_at == pytest.approx(5)
    assert curve.fails_low is not None
    assert curve.fails_high is not None
    # Its crossing is 5 + 50 x the draw's mean shift, whose spread is 0.5 x 0.0707 / sqrt(5) = 0.0158: 0.79 px.
    assert curve.fails_low == pytest.approx(5 - 1.96 * 0.79, abs=0.5)
    assert curve.fails_high == pytest.approx(5 + 1.96 * 0.79, abs=0.5)


def test_points_that_one_setting_lacks_are_left_out() -> None:
    table = [
        *rows(lambda *_: 0.9, temperature_c=0.0, exposures=(0.01, 0.02)),
        *rows(lambda *_: 0.8, temperature_c=25.0, exposures=(0.01,)),
        *rows(lambda *_: 0.7, temperature_c=50.0, exposures=(0.01, 0.02)),
    ]
    found = [
        e for e in endurances_across(list(surfaces(table)), 0.6, generator()) if e.at["velocity_x_px_s"] == 0
    ]
    assert {each.at["exposure_s"]: each.x for each in found} == {0.01: (0.0, 25.0, 50.0), 0.02: (0.0, 50.0)}
