"""Lenses: files, distortion by OpenCV, the field, and effects over it: off, in the chain, in the plan."""

import json
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
import yaml
from exposed_frames import budget

from blurnoise import Camera, simulate
from blurnoise._core.borders import BORDERS
from blurnoise.blur.over_the_field import TOLERANCE
from blurnoise.camera import lens as lenses
from blurnoise.camera.distortion import Distortion
from blurnoise.camera.lens import Mtf, RelativeIllumination
from blurnoise.light import effects
from blurnoise.light.lens import DEFOCUS, DIFFRACTION
from blurnoise.light.motion import MOTION
from blurnoise.light.resolved import Resolved

SENSOR = Camera.preset("imx250").with_figures(width_px=640, height_px=480, hfov_deg=90.0)
H, W = 61, 87
CAMERA = Camera.preset("imx250").with_figures(width_px=2 * W, height_px=2 * H, hfov_deg=70.0)
LIT: dict[str, Any] = {"exposure_s": 0.005, "illuminance_lux": 50.0}
BARREL = Distortion("opencv", (-0.2, 0.02, 0.001, -0.0005))
LENSES = ("distortion", "lateral colour", "defocus", "measured MTF", "vignetting")
MTF = Mtf((0.1, 0.25, 0.5), (0.8, 0.45, 0.1), "cycles/px")
EVERY = {
    "field_curvature_px": 2.0,
    "lateral_red": 0.02,
    "lateral_blue": -0.01,
    "falloff_power": 4.0,
    "distortion": BARREL,
    "mtf": MTF,
    "veil_share": 0.01,
    "halo_share": 0.05,
}


FILED: dict[str, Any] = {
    "field_curvature_px": 1.5,
    "lateral_red": 0.0004,
    "lateral_blue": -0.0003,
    "relative_illumination": {"heights": [0, 0.5, 1], "values": [1, 0.9, 0.6]},
    "distortion": {"model": "opencv", "coefficients": [-0.2, 0.03, 0.001, 0, 0], "focal_px": [2400, 2400]},
    "mtf": {"frequencies": [20, 80, 160], "values": [0.9, 0.6, 0.1], "unit": "lp/mm"},
    "veil_share": 0.01,
    "halo_share": 0.02,
    "t_number": 1.6,
}


def of_file(folder, lens, **others):
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"base": "imx250", "lens": lens, **others}))
    return Camera.load(path)


@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_files_bring_a_lens_back(tmp_path, suffix):
    camera = of_file(tmp_path, FILED)
    assert camera.lens.mtf == Mtf((20.0, 80.0, 160.0), (0.9, 0.6, 0.1), "lp/mm")
    assert camera.lens.relative_illumination == RelativeIllumination((0.0, 0.5, 1.0), (1.0, 0.9, 0.6))
    assert camera.lens.distortion == Distortion("opencv", (-0.2, 0.03, 0.001, 0.0, 0.0), (2400.0, 2400.0))
    assert (camera.lens.veil_share, camera.lens.halo_share, camera.lens.t_number) == (0.01, 0.02, 1.6)
    assert camera.sources["lens"] == "from mine.yaml"
    camera.save(tmp_path / f"camera.{suffix}")
    assert Camera.load(tmp_path / f"camera.{suffix}") == camera
    assert Camera.from_dict(json.loads(json.dumps(camera.to_dict()))) == camera
    assert len({camera, replace(camera, name="mine")}) == 1


def test_curves_of_tables(tmp_path):
    (tmp_path / "mtf.csv").write_text("frequency,on axis,corner\n0,1,1\n80,0.5,0.4\n145,0.2,0.1\n")
    (tmp_path / "light.csv").write_text("0,1\n5.5,0.7\n")
    camera = of_file(
        tmp_path,
        {
            "mtf": {"csv": "mtf.csv", "column": 2, "unit": "lp/mm"},
            "relative_illumination": {"csv": "light.csv", "unit": "mm"},
        },
    )
    assert camera.lens.mtf == Mtf((0.0, 80.0, 145.0), (1.0, 0.4, 0.1), "lp/mm")
    assert camera.lens.relative_illumination == RelativeIllumination((0.0, 5.5), (1.0, 0.7), "mm")
    assert camera.optics.measured is not None
    assert camera.optics.measured.frequencies[1] == pytest.approx(80 * 3.45e-3)


def mtf(frequencies, values, unit="cycles/px"):
    return {"mtf": {"frequencies": frequencies, "values": values, "unit": unit}}


def shape(model, *coefficients, **others):
    return {"distortion": {"model": model, "coefficients": [*coefficients], **others}}


@pytest.mark.parametrize(
    ("lens", "others", "named"),
    [
        (3, {}, "lens = 3: must map figures to values"),
        ({"field_curvature_px": 60}, {}, "lens: field_curvature_px = 60.0: must be finite and >= -50 and <= 50"),
        ({"field_curvatur_px": 1}, {}, "lens: figure 'field_curvatur_px' is unknown (did you mean 'field_curvature"),
        ({"mtf": {"frequencies": [1]}}, {}, "lens: mtf: missing values, unit"),
        (mtf([0.1, 0.5], [1, 1.1]), {}, "lens: mtf: values"),
        (mtf([0.3, 0.1], [1, 0.1]), {}, "lens: mtf: frequencies = (0.3, 0.1): must be >= 0 and increase"),
        (mtf([0, 0.5], [0.9, 0.1]), {}, "lens: mtf: values: must be 1 at frequency 0, got 0.9"),
        (mtf([10, 40], [0.9, 0.6], "lp/mm"), {}, "must reach 0.5 cycles/px (144.928 lp/mm) or a value of 0.05"),
        ({"mtf": {"csv": "no.csv", "unit": "lp/mm"}}, {}, "lens: mtf: csv 'no.csv' cannot be read: No such file"),
        ({"mtf": {"csv": "bad.csv", "unit": "lp/mm"}}, {}, "bad.csv, line 2: expected one of frequencies and"),
        (mtf([0.1, 0.5], [1, 0.1]), {"defocus_radius_px": 1}, "lens.mtf: is measured with defocus and"),
        ({"falloff_power": 4}, {"hfov_deg": 180}, "hfov_deg = 180: must be < 180 for"),
        ({"veil_share": 0.3, "halo_share": 0.4}, {}, "lens: veil_share + halo_share = 0.7: must be at most 0.5"),
        ({"t_number": 1.3}, {}, "t_number = 1.3: must be 0 or at least f_number = 1.4, as no lens passes more"),
        (shape("opencv", 0.1, 0.2), {}, "coefficients = (0.1, 0.2): must be 4 or 5 or 8 numbers, got 2"),
        (shape("fisheye", 0, 0, 0, 0, focal_px=[0, 1]), {}, "lens: distortion: focal_px = 0.0: must be"),
        (shape("opencv", -0.9, 0, 0, 0), {"hfov_deg": 100}, "images nothing beyond 0.4057 focal lengths"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(tmp_path, lens, others, named):
    (tmp_path / "bad.csv").write_text("1,1\n2,x\n")
    with pytest.raises((ValueError, TypeError)) as error:
        of_file(tmp_path, lens, **others)
    assert named in str(error.value)
    assert "mine.yaml" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


MODELS = [
    Distortion("opencv", (-0.28, 0.07, 0.0, 0.0)),
    Distortion("opencv", (-0.28, 0.07, 0.002, -0.001)),
    Distortion("opencv", (0.2, -0.03, 0.0003, 0.001, 0.01)),
    Distortion("opencv", (0.3, -0.1, 0.0004, -0.0002, 0.01, 0.55, -0.05, 0.02)),
    Distortion("fisheye", (0.0, 0.0, 0.0, 0.0)),
    Distortion("fisheye", (-0.02, 0.004, -0.001, 0.0002)),
]


@pytest.mark.parametrize("lens", MODELS)
def test_models_are_opencvs_there_and_back(lens):
    seen = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 21), np.linspace(-0.6, 0.6, 15)))
    own = np.moveaxis(lens.distorted(seen), 0, -1).reshape(-1, 2)
    rays = np.moveaxis(seen, 0, -1).reshape(1, -1, 2)
    if lens.model == "fisheye":
        theirs = cv2.fisheye.distortPoints(rays, np.eye(3), np.array(lens.coefficients))
    else:
        points = np.concatenate([rays[0], np.ones((rays.shape[1], 1))], 1)
        still = np.zeros(3)
        theirs, _ = cv2.projectPoints(points, still, still, np.eye(3), np.array(lens.coefficients))
    np.testing.assert_allclose(own, theirs.reshape(-1, 2), atol=1e-12)
    np.testing.assert_allclose(lens.undistorted(lens.distorted(seen)), seen, atol=1e-9)


def test_what_folds_is_named():
    """r (1 - r^2 / 3) turns at r = 1, where it is 2/3."""
    lens = Distortion("opencv", (-1 / 3, 0.0, 0.0, 0.0))
    inside, _ = lens.undistorted(np.array([[0.66], [0.0]]))
    assert inside[0] * (1 - inside[0] ** 2 / 3) == pytest.approx(0.66)
    with pytest.raises(ValueError, match=r"images nothing beyond 0\.666\d* focal lengths .* reaches 0\.7"):
        lens.undistorted(np.array([[0.7], [0.0]]))
    drawn = lens.before_fold(np.array([[3.0, 0.3], [4.0, 0.4]]))
    np.testing.assert_allclose(np.hypot(*drawn), [1.0, 0.5], atol=1e-3)


def field(**lens):
    return SENSOR.with_figures(**lens).field


def test_natural_vignetting():
    """90 degrees across: 45 at the sides, where cos^4 is 1/4; 640 px of it at half a pixel less."""
    light = lenses.light(field(falloff_power=4.0), (480, 640))
    x = 319.5 / 320
    assert light[240, -1] == pytest.approx((1 + x * x + (0.5 / 320) ** 2) ** -2)
    assert light[240, -1] == pytest.approx(0.25, abs=1e-3)
    assert light.max() == pytest.approx(1, abs=1e-4)
    cubed = lenses.light(field(falloff_power=3.0), (480, 640))
    np.testing.assert_allclose(cubed, light**0.75)
    np.testing.assert_allclose(light, light[::-1, ::-1])


@pytest.mark.parametrize("unit", ["relative", "mm"])
def test_measured_vignetting(unit):
    corner_mm = 400 * 3.45e-3
    heights = (0.0, 0.4, 1.0) if unit == "relative" else (0.0, 0.4 * corner_mm, corner_mm)
    curve = RelativeIllumination(heights, (1.0, 0.9, 0.3), unit)
    light = lenses.light(field(relative_illumination=curve), (96, 128))
    expected = np.interp(field().heights((96, 128)), (0.0, 0.4, 1.0), (1.0, 0.9, 0.3))
    np.testing.assert_allclose(light, expected, atol=1e-12)


@pytest.mark.parametrize("scale", [1, 2])
def test_sources_are_opencvs(scale):
    """What each pixel sees, as cv2.initUndistortRectifyMap has it the other way round; half the size, half of it."""
    shape = Distortion("opencv", (-0.2, 0.04, 0.001, -0.0005, 0.002), (400.0, 410.0), (330.0, 235.0))
    lens = field(distortion=shape)
    size = (480 // scale, 640 // scale)
    back = lens.from_pinhole(lenses.sources(lens, size), size)
    np.testing.assert_allclose(back, np.meshgrid(np.arange(size[1]), np.arange(size[0])), atol=1e-6)
    if scale == 1:
        matrix = np.array([[400.0, 0, 330], [0, 410, 235], [0, 0, 1]])
        theirs = cv2.initUndistortRectifyMap(
            matrix, np.array(shape.coefficients), None, matrix, (640, 480), cv2.CV_32FC1
        )
        grid = np.meshgrid(np.arange(640.0), np.arange(480.0))
        np.testing.assert_allclose(lens.from_pinhole(np.stack(grid), (480, 640)), theirs, atol=1e-3)


def picture(kind=torch.float64, planes=3, size=(H, W)):
    made = torch.rand(1, planes, *size, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return (made > 0.5).to(kind)


def at(camera, displacement_px=(0.0, 0.0)):
    return Resolved(camera, *[torch.zeros(1)] * 3, torch.tensor([displacement_px]))


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_off_is_bit_equal_to_a_chain_without(fidelity, monkeypatch):
    camera = CAMERA.with_figures(defocus_radius_px=1.2, diffraction_wavelength_um=0.55, f_number=2.8)
    frames: dict[str, Any] = {"velocity_px_s": (900.0, 300.0), "generator": [3], "fidelity": fidelity, **LIT}
    off = camera.with_figures(distortion=Distortion("opencv", (0.0, 0.0, 0.0, 0.0)))
    seen = [simulate(picture(), each, **frames) for each in (camera, off)]
    monkeypatch.setattr(effects, "EFFECTS", (DEFOCUS, DIFFRACTION, MOTION))
    before = simulate(picture(), camera, **frames)
    assert all(torch.equal(each, before) for each in seen)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("strength", [0.03, 1.0])
def test_on_changes_the_picture_within_its_bound_and_the_plan_says_so(lens, strength):
    """A picture of the sensor's size, black and white without correlation, or white: never more than the bound."""
    s = strength
    camera = CAMERA.with_figures(width_px=W, height_px=H, **{
        "distortion": {"distortion": Distortion("opencv", (-0.2 * s, 0.0, 0.0, 0.001 * s))},
        "lateral colour": {"lateral_red": 0.02 * s},
        "defocus": {"field_curvature_px": 2.0 * s},
        "measured MTF": {"mtf": Mtf((0.25, 0.5), (1 - 0.5 * s, 1 - 0.9 * s), "cycles/px")},
        "vignetting": {"falloff_power": 4.0 * s},
    }[lens])  # fmt: skip
    effect = next(each for each in effects.EFFECTS if each.name == lens)
    bound = effect.bound(Resolved(camera, 0.01, 25.0, 1000.0, (0.0, 0.0)))
    found = []
    for light in (picture(), torch.ones(1, 3, H, W, dtype=torch.float64)):
        off = effects.through(light, at(camera)) - light
        found.append(float(off.square().mean((0, 2, 3)).sqrt().max()))
    assert 1e-4 * s < max(found) <= 1.1 * bound + TOLERANCE
    assert bound < 20 * strength
    stages = [{each.name: each for each in budget(of, **LIT).stages}[lens] for of in (camera, CAMERA)]
    assert [each.kept for each in stages] == [True, False]
    assert stages[1].contribution_dn == 0


def test_lateral_colour_moves_red_and_blue_against_green():
    """A dot 30 px right of the axis: red 1 % larger is 0.3 px further out; grey pictures have no colour."""
    camera, x = (
        CAMERA.with_figures(lateral_red=0.01, lateral_blue=-0.02),
        torch.arange(W, dtype=torch.float64),
    )
    dot = torch.exp(-(((x - W // 2 - 30) / 3) ** 2) / 2).expand(1, 3, H, W).contiguous()
    row = effects.through(dot, at(camera))[0, :, H // 2]
    places = (row * x).sum(1) / row.sum(1) - W // 2
    assert places.tolist() == pytest.approx([30.3, 30.0, 29.4], abs=0.01)
    grey = dot[:, :1].contiguous()
    assert effects.through(grey, at(camera)) is grey


@pytest.mark.parametrize(("unit", "per"), [("cycles/px", 1.0), ("lp/mm", 1e3 / CAMERA.sensor.pixel_pitch_um)])
def test_a_measured_mtf_blurs_as_the_law_that_it_samples(unit, per):
    """Diffraction, measured at 200 frequencies: the same picture, in one transform with motion."""
    camera, moved = CAMERA.with_figures(f_number=5.6, diffraction_wavelength_um=0.55), (7.0, -2.0)
    f = torch.linspace(0, 0.8, 200, dtype=torch.float64)
    values = camera.optics.response(f, torch.zeros_like(f))
    curve = Mtf(tuple((f * per).tolist()), tuple(values.tolist()), unit)
    of_curve = camera.with_figures(diffraction_wavelength_um=0.0, mtf=curve)
    off = effects.through(picture(), at(of_curve, moved)) - effects.through(picture(), at(camera, moved))
    assert float(off.square().mean().sqrt()) < 3e-4


def test_distortion_shows_the_scene_where_the_field_says():
    """A smooth scene, seen through barrel distortion, is that scene at the pixels' directions."""
    camera = CAMERA.with_figures(distortion=BARREL)

    def scene(x, y):
        return 0.5 + 0.3 * torch.sin(torch.as_tensor(x) * 0.3) * torch.cos(torch.as_tensor(y) * 0.2)

    y, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) for n in (H, W)), indexing="ij")
    source_x, source_y = lenses.sources(camera.field, (H, W))
    seen = effects.through(scene(x, y)[None, None], at(camera))[0, 0]
    inside = torch.from_numpy((source_x > 12) & (source_x < W - 13) & (source_y > 12) & (source_y < H - 13))
    assert float((seen - scene(source_x, source_y))[inside].abs().max()) < 1e-4
    assert float((source_x - x.numpy()).max()) > 3


@pytest.mark.parametrize("border", BORDERS)
def test_beyond_the_scene_is_black(border):
    """A dot at the edge stays one under barrel distortion, and all that a pincushion shows is of the scene."""
    barrel = CAMERA.with_figures(distortion=Distortion("opencv", (-0.2, 0.0, 0.0, 0.0)))
    dot = torch.zeros(1, 1, H, W)
    dot[..., 4:9, 4:9] = 1.0
    seen = effects.through(dot, at(barrel), border=border)[0, 0].numpy()
    regions, _ = cv2.connectedComponents((seen > 0.3).astype(np.uint8))
    assert regions == 2  # one, and what is around it
    x, y = lenses.sources(barrel.field, (H, W))
    beyond = (x < -1) | (x > W) | (y < -1) | (y > H)
    white = effects.through(torch.ones_like(dot), at(barrel), border=border)[0, 0].numpy()
    assert beyond.mean() > 0.1
    assert not white[beyond].any()
    inside = (x > 0) & (x < W - 1) & (y > 0) & (y < H - 1)
    assert np.abs(white - 1)[inside].max() < (0.3 if border == "constant" else 1e-5)
    pincushion = CAMERA.with_figures(distortion=Distortion("opencv", (0.2, 0.0, 0.0, 0.0)))
    assert lenses.inside(pincushion.field, (H, W)) is None


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 5)])
def test_pictures_of_few_pixels(size):
    seen = simulate(picture(size=size), CAMERA.with_figures(**EVERY), generator=[1], fidelity="full", **LIT)
    assert seen.shape == (1, 3, *size)
    assert torch.isfinite(seen).all()
