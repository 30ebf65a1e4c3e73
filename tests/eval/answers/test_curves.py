"""Curves of a group of targets: what belongs together, how sure the mean is, where it fails."""

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import endurances
from made_tables import curve, over, tables
from plans import OWN

EXPOSURES_S = (0.01, 0.02, 0.04)
SPEEDS_PX_S = (0.0, 100.0, 400.0)


def rows(
    confidence,
    *,
    images=4,
    repeats=1,
    velocities=tuple((speed, 0.0) for speed in SPEEDS_PX_S),
    exposures=EXPOSURES_S,
    **fields,
):
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


def test_means_leave_out_what_was_not_measured():
    def some(image, _, exposure_s, speed):
        if exposure_s == 0.04 and speed == 400.0:
            return None
        return None if image == "p0" and speed == 100.0 else {"p0": 1.0, "p1": 0.4}.get(image, 0.1)

    measured = [row | {"saturated_share": 0.1 * int(row["image"][1:])} for row in rows(some)]
    (table,) = tables(measured)
    mean = over(table, table.mean)
    assert np.isnan(mean[2, 2])
    assert mean[0] == pytest.approx([1.6 / 4, 0.6 / 3, 1.6 / 4])
    assert over(table, table.saturated)[0] == pytest.approx([0.15, 0.2, 0.15])
    found = list(endurances(table, Criterion(0.6, kept=False)))
    by_exposure = next(
        each for each in found if each.axis == "exposure_s" and each.conditions["velocity_x_px_s"] == 400.0
    )
    by_blur = next(each for each in found if each.axis == "blur_px" and each.conditions["exposure_s"] == 0.04)
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


def test_area_and_failure_of_a_straight_line():
    """Confidence 1 - blur / 20 px: at 40 ms and 0 to 16 px its mean is 0.6 and it crosses 0.7 at 6 px."""
    velocities = tuple((speed, 0.0) for speed in (0.0, 100.0, 200.0, 400.0))
    every = rows(lambda _i, _r, _t, v: 1 - 0.04 * v / 20, velocities=velocities, exposures=(0.04,))
    (curve,) = endurances(*tables(every), Criterion(0.7, kept=False))
    assert (curve.axis, curve.conditions["exposure_s"], curve.conditions["velocity_x_px_s"]) == (
        "blur_px",
        0.04,
        None,
    )
    assert curve.x == pytest.approx((0, 4, 8, 16))
    assert (curve.auc, curve.fails_at) == (pytest.approx(0.6), pytest.approx(6))
    assert (curve.fails_low, curve.fails_high, curve.auc_low) == (None, None, None)  # four pictures
    assert (curve.n_pictures, curve.few_pictures) == (4, True)
    assert not curve.non_monotonic


@pytest.mark.parametrize("steep", [0.02, 0.08])
@pytest.mark.parametrize("falls_at_s", [0.0102, 0.0199])
def test_an_end_lies_between_the_tested_exposures_about_it(falls_at_s, steep):
    """Forty pictures, all alike, lose their target within 0.02 or 0.08 decades: straight lines between 10 and 20 ms
    cross at about 14 ms wherever it is, and the interval about 14 ms held nothing of it."""
    x = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
    mean = 1 / (1 + np.exp((np.log10(x) - np.log10(falls_at_s)) / steep))
    of = curve(np.tile(mean, (40, 1)), x)
    low, high = of.around(of.windows(0.5)[-1][1], 0.5)
    assert low <= falls_at_s <= high
    assert {low, high} <= set(x)


X = tuple((0.001 * 2.0 ** np.linspace(0, 6, 13)).tolist())
_DRAWN = np.random.default_rng(3).uniform(-0.2, 0.2, (30, 1)) + np.linspace(0.4, 0.8, 13)
COV = 0.02**2 * np.exp(-np.abs(np.subtract.outer(np.arange(13), np.arange(13))) / 4)


def predicted(cov):
    return curve(_DRAWN, X, prediction_cov=cov if cov is None else lambda those: cov[np.ix_(those, those)])


def test_half_widths_of_a_prediction_add_as_squares():
    """And where nothing is open it is as measured, but for steps between the values."""
    known, unsure, measured = (predicted(cov).interval() for cov in (0 * COV, COV, None))
    mean = predicted(None).line.mean
    np.testing.assert_allclose(known, measured)
    for one, other in zip(known, unsure, strict=True):
        assert np.abs(other - mean) == pytest.approx(np.hypot(one - mean, 1.96 * 0.02))
    assert predicted(COV).sure(0.6)[0][0] > predicted(None).sure(0.6)[0][0]
    assert predicted(COV).possible(0.6)[0][0] < predicted(None).possible(0.6)[0][0]
    of = predicted(COV)  # known between its values, too
    assert of.around(of.windows(0.6)[0][0], 0.6) == (of.possible(0.6)[0][0], of.sure(0.6)[0][0])


def test_what_is_kept_is_a_ratio_of_sums():
    """a: 0.8 and 0.1 untouched, 0.4 in two noise fields each; b: 0.5 and 0; c has no original picture."""
    clean = {("a", 0): 0.8, ("a", 1): 0.1, ("b", 0): 0.5, ("b", 1): 0.0}
    seen = {
        ("a", 0): (0.4, 0.6),
        ("a", 1): (0.2, 0.2),
        ("b", 0): (0.5, 0.4),
        ("b", 1): (0.1, 0.0),
        ("c", 0): (0.9, 0.9),
    }
    shared = {"model": "m", "group": "g", "exposure_s": 0.01, "illuminance_lux": 50.0, **OWN}
    shared |= {"velocity_x_px_s": 0.0, "velocity_y_px_s": 0.0}
    every = [
        {**shared, "image": image, "target_id": target, "repeat": repeat, "confidence": confidence}
        for (image, target), fields in seen.items()
        for repeat, confidence in enumerate(fields)
    ]
    (found,) = tables(every, clean_of=lambda row: clean.get((row["image"], row["target_id"])), kept=True)
    assert found.clusters == ("a", "b")
    assert found.counts[:, 0] == pytest.approx([2 * 0.9, 2 * 0.5])
    assert found.mean[0] == pytest.approx((1.4 + 1.0) / 2.8)
    assert (found.n_targets, found.clean, found.reference) == (8, pytest.approx(0.35), pytest.approx(1.4))
    assert found.most == pytest.approx(8 / 2.8)  # if all had confidence 1
