"""Strengths of noise reduction found again in developed flat frames, of our own filter and of others."""

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.calibration.developed import AtGain, measure_developed, noise_of
from blurnoise_eval.datasets import write_picture
from commands import main
from PIL import Image

from blurnoise import Camera, Exposure, Scene, take_each
from blurnoise.camera.isp import NoiseReduction, Sharpening
from blurnoise.scene.take import EIGHT_BIT

BASE = Camera.preset("imx250c")
REDUCED = BASE.with_figures(noise_reduction=(NoiseReduction(0.0, 10.0, 16.0, 0.8),))
SHARP = REDUCED.with_figures(sharpening=(Sharpening(strength=1.5),))


def flats(camera, lux, seed, filtered=None, gain_db=18.0, count=4, side=192):
    scene = Scene(torch.full((1, 1, side, side), 0.5))
    at = [Exposure(camera, 0.01, lux, gain_db=gain_db, seed=seed + n) for n in range(count)]
    taken = [np.ascontiguousarray(frames.images()[0]) for frames in take_each(scene, at, EIGHT_BIT)]
    return [filtered(picture) if filtered else picture for picture in taken]


def folder_of(root, pictures, gain_db=18.0, suffix=".png"):
    root.mkdir(exist_ok=True)
    for n, picture in enumerate(pictures):
        write_picture(root / f"{n}{suffix}", picture)
    rows = [f"{n}{suffix},{gain_db}" for n in range(len(pictures))]
    (root / "frames.csv").write_text("\n".join(["file,gain_db", *rows]))
    return root


CASES = {
    "plain": (BASE, None),
    "own": (REDUCED, None),
    "own, sharpened": (SHARP, None),
    "median": (BASE, lambda picture: cv2.medianBlur(picture, 3)),
    "blur": (BASE, lambda picture: cv2.GaussianBlur(picture, (0, 0), 0.8)),
    "colours": (BASE, lambda picture: cv2.bilateralFilter(picture, 9, 25, 4)),
    "JPEG": (REDUCED.with_figures(jpeg_quality=85), None),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_noise_and_spectrum_at_another_brightness_are_those_of_the_camera(tmp_path, case):
    """The bars are those of the module; three of the filters are not ours."""
    camera, filtered = CASES[case]
    pictures = flats(camera.with_figures(jpeg_quality=None), 8.0, 100, filtered)
    folder = folder_of(tmp_path / "flats", pictures)
    if camera.isp.jpeg_quality:
        for n, picture in enumerate(pictures):
            Image.fromarray(picture).save(folder / f"{n}.jpg", quality=camera.isp.jpeg_quality)
        (folder / "frames.csv").write_text((folder / "frames.csv").read_text().replace("png", "jpg"))
    found = measure_developed(folder, BASE)
    assert found.doubts == ()
    fitted = BASE.with_figures(**{name: value for name, (value, _) in found.known.items()})
    assert fitted.isp.jpeg_quality == camera.isp.jpeg_quality
    taken, simulated = (
        noise_of(flats(by, 4.0, seed, f)) for by, seed, f in ((camera, 500, filtered), (fitted, 900, None))
    )
    apart = AtGain(18.0, found.gains[0].noise_reduction, found.gains[0].sharpening, taken, simulated)
    assert apart.noise_off < 0.15
    assert apart.spectrum_off < 0.25


@pytest.mark.slow
def test_a_camera_file_has_the_steps_with_their_source(tmp_path, capsys):
    folder = folder_of(tmp_path / "flats", flats(REDUCED, 8.0, 100), suffix=".jpg")
    assert (
        main(["cameras", "fit", "--developed", folder, "--base", "imx250c", "-o", tmp_path / "mine.yaml"])
        == 0
    )
    assert "developed, 18 dB: luma" in " ".join(capsys.readouterr().out.split())
    camera = Camera.load(tmp_path / "mine.yaml")
    assert camera.isp.noise_reduction[0].gain_db == 18.0
    assert camera.isp.jpeg_quality == 95  # OpenCV's
    assert camera.sources["noise_reduction"].startswith("measured: noise of 4 developed flat frames in flats")


def test_white_noise_has_one_power_in_all_octaves_and_shading_has_none():
    """5 sigma of a mean of as many powers as the octave has."""
    drawn = np.random.default_rng(1).normal(0, 6, (6, 256, 256, 1))
    shade = 100 + 40 * np.linspace(0, 1, 256)[:, None, None]
    noise = noise_of((drawn + shade).round().clip(0, 255).astype(np.uint8).repeat(3, 3))
    variance = 6.0**2 + 1 / 12
    assert noise.deviation_dn == pytest.approx([variance**0.5, 0.0], rel=0.01, abs=1e-4)
    assert noise.power[0] == pytest.approx([variance] * 4, rel=0.15)
    assert noise.power[0][0] == pytest.approx(variance, rel=0.03)


def test_coarse_noise_is_in_the_coarse_octaves_and_chroma_is_told_from_luma():
    drawn = np.random.default_rng(1).normal(0, 60, (4, 256, 256, 3))
    drawn[..., 1:] = 0  # red alone: 0.299 of it in luma, 0.5 and 0.169 in the planes of chroma
    coarse = np.stack([cv2.GaussianBlur(each, (0, 0), 3.0) for each in drawn]) + 128
    noise = noise_of(coarse.round().astype(np.uint8))
    assert noise.power[0][3] > 20 * noise.power[0][1] > 20 * noise.power[0][0]
    assert noise.deviation_dn[1] / noise.deviation_dn[0] == pytest.approx(0.3735 / 0.299, rel=0.02)


GREY = [np.full((96, 96, 3), 120, np.uint8) + np.uint8(n) for n in range(2)]
NOISY = [(120 + np.random.default_rng(n).normal(0, 3, (96, 96, 3))).astype(np.uint8) for n in range(2)]


@pytest.mark.parametrize(
    ("pictures", "why"),
    [
        ([NOISY[0], NOISY[0]], "are all alike; must be two exposures of a surface, not copies"),
        ([NOISY[0], NOISY[1] // 2], "have mean values from 59 to 120; must be of one light and exposure"),
        ([GREY[0] // 12, GREY[1] // 12], "have the mean value 10; must be from 16 to 235"),
        (NOISY[:1], "1 frame at 18 dB; must be two or more"),
        ([NOISY[0], NOISY[1][:, :80]], "must all have one size"),
        ([picture[:40] for picture in NOISY], "must be at least 64 px per side"),
    ],
)
def test_wrong_frames_are_one_line(tmp_path, pictures, why):
    with pytest.raises(ValueError, match=why):
        measure_developed(folder_of(tmp_path / "flats", pictures), BASE)


def test_gains_come_from_the_list_or_from_iso(tmp_path):
    folder = folder_of(tmp_path / "flats", NOISY)
    (folder / "frames.csv").write_text("file,gain_db\n0.png,x\n1.png,0")
    with pytest.raises(ValueError, match=r"frames.csv: must have the columns file and gain_db \(0 to 100\)"):
        measure_developed(folder, BASE)
    (folder / "frames.csv").unlink()
    with pytest.raises(ValueError, match=r"0.png: ISO is missing; add it to EXIF or to frames.csv"):
        measure_developed(folder, BASE)
    for n, iso in enumerate((100, 100, 400)):
        exif = Image.Exif()
        exif[0x8769] = {34855: iso}
        Image.fromarray(NOISY[0]).save(folder / f"{n}.png", exif=exif)
    with pytest.raises(ValueError, match=r"1 frame at 12\.04 dB; must be two or more"):
        measure_developed(folder, BASE)
    Image.fromarray(NOISY[1]).save(folder / "3.jpg", exif=exif)
    with pytest.raises(ValueError, match="frames of several encodings"):
        measure_developed(folder, BASE)
