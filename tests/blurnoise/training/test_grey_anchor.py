"""The grey anchor of training pictures: light of a photograph that does not follow how it was exposed."""

import pytest
import torch

from blurnoise import AutoExposure, Camera, Exposure, RandomExposure, expose_pictures
from blurnoise.training.table import ConditionRow, ExposureTable

CAMERA = Camera.preset("imx250c")
LIT = {"exposure_s": 0.01, "illuminance_lux": 60.0, "seed": 3}


def flat(*greys):
    return torch.stack([torch.full((3, 12, 15), grey) for grey in greys])


@pytest.mark.parametrize("gain_db", [0.0, AutoExposure()])
def test_light_and_meter_count_from_the_anchor(gain_db):
    """Two greys with the mean as their anchor are taken as the grey card is."""
    given = {"encoding": "linear"}
    exposure = Exposure(CAMERA, gain_db=gain_db, **LIT)
    seen = expose_pictures(flat(0.09, 0.36), exposure, grey_anchor="mean", **given)
    card = expose_pictures(flat(0.18, 0.18), exposure, **given)
    assert torch.allclose(seen, card, atol=1e-6)
    assert not torch.allclose(expose_pictures(flat(0.09, 0.36), exposure, **given), card, atol=0.01)


def test_what_moves_before_the_background_has_it_too():
    exposure = Exposure(CAMERA, velocity_px_s=(300.0, 0.0), moves="targets", **LIT)
    masks = torch.zeros(1, 1, 12, 15)
    masks[..., 3:9, 4:10] = 1
    given = {"encoding": "linear", "masks": masks}
    seen = expose_pictures(flat(0.72), exposure, grey_anchor="0,0,15,12", **given)
    assert torch.allclose(seen, expose_pictures(flat(0.18), exposure, **given), atol=1e-6)


def test_a_black_picture_of_a_batch_stays_black():
    seen = expose_pictures(flat(0.0, 0.5), Exposure(CAMERA, **LIT), encoding="linear", grey_anchor="mean")
    assert float(seen[0].mean()) < 0.01 < float(seen[1].mean())


def test_the_anchor_of_a_run_is_that_of_its_table():
    table = ExposureTable(CAMERA, (ConditionRow(0.01, 60.0),), grey_anchor="p50")
    assert RandomExposure(table=table).flags["grey_anchor"] == "p50"
    assert RandomExposure(table=table, grey_anchor="mean").flags["grey_anchor"] == "mean"
    ranges = {"exposure_s": 0.01, "illuminance_lux": 60.0}
    assert RandomExposure(CAMERA, **ranges).flags["grey_anchor"] is None
    augment = RandomExposure(CAMERA, p=1.0, encoding="linear", grey_anchor="mean", **ranges)
    assert float(augment(flat(0.02)).mean()) == pytest.approx(float(augment(flat(0.18)).mean()), rel=0.05)


@pytest.mark.parametrize(
    "made",
    [
        lambda: RandomExposure(CAMERA, exposure_s=0.01, illuminance_lux=60.0, grey_anchor="card"),
        lambda: ExposureTable(CAMERA, (ConditionRow(0.01, 60.0),), grey_anchor="card"),
        lambda: expose_pictures(flat(0.5), Exposure(CAMERA, **LIT), grey_anchor="card"),
    ],
)
def test_another_word_is_one_line(made):
    with pytest.raises(ValueError, match=r"grey_anchor = 'card': must be mean, pNN"):
        made()
