"""What photographs bring along: pictures of known noise, JPEG quality and clipping, and what the commands say."""

import cv2
import numpy as np
import pytest
from blurnoise_eval import expose
from blurnoise_eval.datasets import image_folder, rendered_signs
from blurnoise_eval.measure.photographs import (
    Photographs,
    about_photographs,
    flat_noise,
    photographs,
    raised,
)
from blurnoise_eval.plan.plan import SweepPlan, usual_plan
from commands import main

from blurnoise import Camera


def scene(height=272, width=336):
    """Luma of a smooth sky above fine texture, which is far from flat."""
    y, x = np.mgrid[:height, :width]
    sky = 120 + 30 * np.sin(x / 60.0) + 20 * np.cos(y / 50.0)
    texture = cv2.GaussianBlur(np.random.default_rng(7).normal(0, 60, (height, width)), (0, 0), 2.0)
    return sky + np.where(y > height * 0.6, texture, 0.0)


def coded(luma, quality=None):
    image = luma.round().clip(0, 255).astype(np.uint8)
    if quality is None:
        return image
    return cv2.imdecode(
        cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE
    )


def grey(luma, quality=None):
    return coded(luma, quality)[..., None].repeat(3, 2)


@pytest.mark.parametrize("noise_dn", [0.5, 0.7, 1.5, 4.0])
def test_noise_of_flat_parts_is_found_beside_texture(noise_dn):
    """Within 5 %: of 8 or more squares of 256 values, a median's error is 1.25 / sqrt(2 * 8 * 256) = 2 %."""
    drawn = np.random.default_rng(3).normal(0, noise_dn, scene().shape)
    found, level = flat_noise(grey(scene() + drawn))
    assert found == pytest.approx(np.hypot(noise_dn, 12**-0.5), rel=0.05)
    assert 70 < level < 170


@pytest.mark.parametrize(("quality", "left"), [(98, 1.0), (90, 0.6), (75, 0.22)])
def test_of_a_jpeg_it_is_the_fine_noise_that_the_encoder_left(quality, left):
    """The truth: the difference to the same picture without noise, by second differences.
    Flat squares are those in which less is left: 15 %."""
    drawn = np.random.default_rng(3).normal(0, 3.7, scene().shape)
    noise = (coded(scene() + drawn, quality).astype(float) - coded(scene(), quality))[8:150, 8:-8]
    corners = noise[:-2, :-2] - 2 * noise[:-2, 1:-1] + noise[:-2, 2:] + noise[2:, :-2] - 2 * noise[2:, 1:-1]
    fine = corners + noise[2:, 2:] - 2 * (noise[1:-1, :-2] + noise[1:-1, 2:]) + 4 * noise[1:-1, 1:-1]
    found, _ = flat_noise(grey(scene() + drawn, quality))
    assert found == pytest.approx(fine.std() / 6, rel=0.15)
    assert found == pytest.approx(left * 3.7, rel=0.15)


def test_pictures_without_flat_parts_say_nothing():
    assert flat_noise(np.zeros((400, 400, 3), np.uint8)) is None
    assert flat_noise(np.full((60, 60, 3), 99, np.uint8)) is None
    assert photographs([(None, np.full((400, 400, 3), 255, np.uint8))]) is None


def test_medians_are_over_pictures_and_clipped_parts_are_counted(tmp_path):
    pictures = []
    for place, noise_dn in enumerate((1.0, 2.0, 9.0)):
        luma = scene() + np.random.default_rng(place).normal(0, noise_dn, scene().shape)
        image = grey(luma)
        image[:34] = 255, 120, 10  # an eighth of the rows
        cv2.imwrite(str(tmp_path / f"{place}.jpg"), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        pictures.append((tmp_path / f"{place}.jpg", image))
    found = photographs(pictures)
    assert found.noise_dn == pytest.approx(2.0, rel=0.06)
    assert found.noisiest_dn == pytest.approx(2.0 + 0.8 * 7.0, rel=0.06)
    assert found.clipped == pytest.approx((0.125,) * 3, abs=0.005)
    assert found.jpeg_quality == pytest.approx(90, abs=1)
    assert "JPEG quality 90, which leaves coarse noise that looks like scene" in found.texts
    assert found.texts[-1].startswith("3 of 3 pictures clip, 12% of their pixels: grey in darker frames")


def test_few_pictures_with_a_clipped_sky_are_said():
    """A median over all pictures would hide them."""
    plain, sky = grey(scene()), grey(scene())
    sky[:68] = 255
    pictures = [(None, plain), (None, sky), (None, plain)]
    assert any(text.startswith("1 of 3 pictures clip, 25%") for text in photographs(pictures).texts)
    assert len(photographs([(None, plain)]).texts) == 1


def test_frames_are_compared_with_and_without_the_noise():
    """In the dark the camera's noise covers it; in daylight both add in squares."""
    camera = Camera.preset("imx250m").with_figures(falloff_power=0.0)
    plan = SweepPlan(
        {"exposure_s": (0.001, 0.5), "illuminance_lux": (0.01, 500.0), "velocity_x_px_s": (0.0,)}
    )
    shares = raised(Photographs(2.0, 4.0, 118.0, (), None), camera, plan)
    assert shares[0.01][1] < 0.1 < shares[500.0][0] < shares[500.0][1]
    flat = np.full((200, 200, 3), 118, np.uint8)
    own = expose(flat, camera, exposure_s=0.001, illuminance_lux=500.0, gain_db="auto").image[..., 0].std()
    assert shares[500.0][1] == pytest.approx(np.hypot(1.0, 4.0 / own) - 1, rel=0.1)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "photos").mkdir()
    noisy = (scene() + np.random.default_rng(3).normal(0, 3.0, scene().shape))[:224, :240]
    cv2.imwrite(str(tmp_path / "photos" / "a.png"), grey(noisy))
    return tmp_path / "photos"


def test_a_sweep_says_so_once(folder, tmp_path, capsys):
    at = ("--lux", "1,2000", "--exposure-ms", "1", "--dx", "0", "--threads", "1")
    assert main(["sweep", "--images", str(folder), "-o", str(tmp_path / "run"), *at]) == 0
    seen = " ".join(capsys.readouterr().out.split())
    known = (
        "pictures: fine noise and texture of 3 DN in flat parts, simulated once more: frames at 2000 lux have"
    )
    assert seen.count(known) == 1
    assert "more noise, up to 1 lux less than 1 %" in seen


def test_rendered_pictures_and_pictures_without_flat_parts_have_no_line(tmp_path):
    cv2.imwrite(str(tmp_path / "white.png"), np.full((300, 300, 3), 255, np.uint8))
    for pictures in (rendered_signs((50,), count=1), image_folder(tmp_path)):
        assert about_photographs(pictures, Camera.preset("imx250"), usual_plan()) is None
