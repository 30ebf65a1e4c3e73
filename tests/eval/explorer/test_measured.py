"""MTF50 of lens and motion against closed forms; motion of a picture, and of a camera that drives."""

from __future__ import annotations

import math

import pytest
from blurnoise_eval.explorer.measured import motion_px, mtf50

from blurnoise import Camera, Exposure, Optics


def test_of_motion_alone() -> None:
    assert mtf50(Optics(), (8.0, 0.0)) == pytest.approx(0.603355 / 8, rel=1e-4)
    assert mtf50(Optics(), (3.0, 4.0), 90) == pytest.approx(0.603355 / 4, rel=1e-4)
    assert mtf50(Optics(), (3.0, 4.0), math.degrees(math.atan2(4, 3))) == pytest.approx(
        0.603355 / 5, rel=1e-4
    )


def test_of_a_lens_alone() -> None:
    assert mtf50(Optics(defocus_radius_px=2.0), angle_deg=37) == pytest.approx(0.352542 / 2, rel=1e-4)
    assert mtf50(Optics(gaussian_sigma_px=1.5)) == pytest.approx(0.187391 / 1.5, rel=1e-4)


def test_beyond_sampling_there_is_none() -> None:
    assert mtf50(Optics()) == math.inf
    assert mtf50(Optics(), (1.0, 0.0)) == math.inf
    assert mtf50(Optics(), (1.3, 0.0)) == pytest.approx(0.603355 / 1.3, rel=1e-4)


def test_motion_is_velocity_times_exposure_or_what_the_pixels_of_a_driven_camera_see() -> None:
    camera = Camera.preset("imx250")
    moved = motion_px(Exposure(camera, 0.02, 5.0, (300.0, -400.0)), (48, 64))
    assert moved.blur_px == pytest.approx(0.02 * 500)
    assert moved.angle_deg == pytest.approx(-53.1301)
    assert moved.varies == 0
    driven = Exposure(camera, 0.02, 5.0, ego_speed_m_s=20.0)
    flow = driven.vehicle.flow_px_s(camera, (48, 64), 20.0) * 0.02
    middle = motion_px(driven, (48, 64))
    for place, along in enumerate((middle.x, middle.y)):
        assert float(flow[place].min()) <= along <= float(flow[place].max())
    away = (flow - flow.new_tensor([middle.x, middle.y])[:, None, None]).square().sum(0).sqrt()
    assert middle.varies == pytest.approx(float(away.max()), rel=1e-5)
