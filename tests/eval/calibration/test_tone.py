"""Tone curves found again in brackets and grey scales of curves that are written out here."""

from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.calibration.bracket import listed
from blurnoise_eval.calibration.tone import fit_tone, measure_tone
from blurnoise_eval.datasets import decode, write_picture
from commands import main
from PIL import Image
from scipy.ndimage import gaussian_filter

from blurnoise import Camera, Scene

GRID = np.linspace(0.0, 1.0, 401)


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def shouldered(light):
    """A camera's: contrast in the middle, as of sRGB and its smoothstep."""
    value = srgb(light)
    return 0.6 * value + 0.4 * (3 * value**2 - 2 * value**3)


def scene(seed):
    """Reflectances of two decades, (64, 80)."""
    return np.minimum(1.0, np.exp(np.random.default_rng(seed).normal(-1.8, 1.1, (64, 80))))


def bracket(folder, curve, noise=0.0, times=(1, 2, 4, 8, 16)):
    """Pictures of 8 bits; at 4 ms white is full scale."""
    folder.mkdir()
    random, rows = np.random.default_rng(1), ["file,exposure_s"]
    for time in times:
        light = scene(0) * time / 4
        light = np.clip(light + noise * np.sqrt(light + 1e-3) * random.normal(size=light.shape), 0, 1)
        write_picture(folder / f"{time:g}.png", np.rint(255 * curve(light)).astype(np.uint8))
        rows.append(f"{time:g}.png,{time / 1000}")
    (folder / "frames.csv").write_text("\n".join(rows))
    return folder


CURVES = [
    (lambda light: light ** (1 / 2.2), 0.0),
    (shouldered, 0.0),
    (shouldered, 0.01),
    (lambda light: light, 0.0),
]


@pytest.mark.parametrize(("curve", "noise"), CURVES, ids=["gamma", "shoulder", "noisy", "linear"])
def test_a_bracket_gives_the_curve_within_a_hundredth(tmp_path, curve, noise):
    found = measure_tone(bracket(tmp_path / "bracket", curve, noise))
    assert np.abs(np.interp(GRID, *np.array(found.points).T) - curve(GRID)).max() < 0.01
    assert found.doubts == ()
    # rounding alone is 0.29 less the pixel's own light
    residual = float(found.text.split("residual ")[1].split()[0])
    assert 0.1 < residual < 0.3 if noise == 0 else residual > 0.5


def test_a_picture_made_linear_by_it_is_the_reflectance(tmp_path):
    """Within 2 %, and what 8 bits round, from a tenth of white on; the file is a camera's, and a tone."""
    folder, path = bracket(tmp_path / "bracket", shouldered), tmp_path / "mine.yaml"
    assert main(["cameras", "fit", "--tone", folder, "--base", "imx250m", "-o", path]) == 0
    camera = Camera.load(path)
    assert camera.sources["tone"].startswith("measured: bracket of 5 pictures, residual 0.")
    assert camera.sources["f_number"] == "assumed, as of the preset imx250m"
    picture = np.repeat(decode(folder / "4.png")[..., None], 3, 2)
    light = Scene.of_picture(picture, encoding=camera.isp.tone).light[0, 0].numpy()
    bright = (scene(0) > 0.1) & (scene(0) < 0.95)
    assert light[bright].mean() == pytest.approx(scene(0)[bright].mean(), rel=0.02)
    rounds = 0.5 / 255 / np.gradient(shouldered(GRID), GRID)  # light that half a value is worth
    allowed = 0.02 * scene(0) + np.interp(scene(0), GRID, rounds)
    assert (np.abs(light - scene(0)) < allowed)[bright].mean() > 0.99
    # a later fit keeps the rest of the file with its sources
    assert main(["cameras", "fit", "--tone", folder, "--base", path, "-o", tmp_path / "again.yaml"]) == 0
    assert Camera.load(tmp_path / "again.yaml").sources == camera.sources


def test_a_grey_scale_gives_it_too(tmp_path):
    light = 0.9 * 10 ** -np.linspace(1.7, 0, 12)
    rows = [f"{round(255 * value)},{each}" for value, each in zip(shouldered(light), light, strict=True)]
    (tmp_path / "scale.csv").write_text("\n".join(["number,light", *rows]))
    found = measure_tone(tmp_path / "scale.csv")
    assert np.abs(np.interp(GRID, *np.array(found.points).T) - shouldered(GRID)).max() < 0.01


def test_exposures_are_those_of_exif(tmp_path):
    """JPEG, with time and ISO; blocks of a value, which compression leaves alone."""
    steps = np.repeat(np.repeat(np.linspace(0.02, 1, 64).reshape(8, 8), 16, 0), 16, 1)
    for number, (time, iso) in enumerate(((0.01, 100), (0.01, 200), (0.01, 400), (0.08, 100))):
        light = np.minimum(1, steps * time / 0.01 * iso / 400)
        picture = Image.fromarray(np.rint(255 * shouldered(light)).astype(np.uint8))
        exif = Image.Exif()
        exif.get_ifd(0x8769).update({33434: time, 34855: iso})
        picture.save(tmp_path / f"{number}.jpg", exif=exif, quality=98)
    found = measure_tone(tmp_path)
    assert np.abs(np.interp(GRID, *np.array(found.points).T) - shouldered(GRID)).max() < 0.015


def test_a_wrong_exposure_time_is_named_and_left_out(tmp_path):
    folder = bracket(tmp_path / "bracket", shouldered)
    rows = (folder / "frames.csv").read_text().replace("2.png,0.002", "2.png,0.0023")
    # as Excel has it elsewhere
    (folder / "frames.csv").write_text(rows.replace(",", ";").replace(";0.", ";0,"))
    found = measure_tone(folder)
    assert found.left_out == ("2.png: its light is -13% off its exposure time",)  # 1 / 1.15
    assert found.left_out[0] in found.known["tone"][1]
    assert found.names == ("1.png", "4.png", "8.png", "16.png")
    assert np.abs(np.interp(GRID, *np.array(found.points).T) - shouldered(GRID)).max() < 0.01


def photographs(shift_px=(0, 0, 0, 0, 0), curve=shouldered):
    """Five pictures of one scene of soft edges, a stop apart, that clip at 241 to 254 in place of 255."""
    random = np.random.default_rng(2)
    soft = gaussian_filter(random.normal(size=(120, 168)), 4, mode="wrap")
    light, pictures = np.exp(1.3 * soft / soft.std() - 1.5), []
    for number, shift in enumerate(shift_px):
        value = 255 * curve(np.clip(np.roll(light, shift, 1) * 2.0 ** (number - 2), 0, 1))
        ringing = np.clip(random.normal(250, 3, value.shape), 241, 254)
        pictures.append(np.rint(np.where(value > 250, ringing, value)).astype(np.uint8))
    return pictures, [2.0**number for number in range(len(shift_px))], list("abcde")


def test_areas_that_clip_below_255_do_not_count():
    """Those of a JPEG: the curve is that of the light, 1 where pictures reach the usual value of such areas."""
    tone = fit_tone(*photographs())
    assert tone.response.top in range(238, 247)
    assert "clipped areas from value 24" in tone.text
    light, values = np.array(tone.points).T
    assert values[-1] == pytest.approx(250 / 255, abs=0.005)
    # light 1 is that of values of 250: as a share of it
    one = np.interp(250 / 255, shouldered(GRID), GRID)
    assert np.interp(GRID, light * one, values)[:380] == pytest.approx(shouldered(GRID)[:380], abs=0.012)


def test_pictures_of_hardly_any_light_are_not_blamed(tmp_path):
    """Their noise and rounding, of one value in three, are no wrong exposure times."""
    dark = bracket(tmp_path / "bracket", shouldered, noise=0.01, times=(0.01, 0.02, 1, 2, 4, 8, 16))
    found = measure_tone(dark)
    assert (found.left_out, found.doubts) == ((), ())
    assert np.isnan(found.response.offsets[:1]).all()
    assert np.abs(np.interp(GRID, *np.array(found.points).T) - shouldered(GRID)).max() < 0.02


def test_a_picture_that_moved_is_named_and_left_out():
    tone = fit_tone(*photographs((0, 0, 5, 0, 0)))
    assert tone.left_out == ("c: moved by 5 px",)
    assert tone.names == tuple("abde")
    with pytest.raises(ValueError, match=r"bracket: a: moved by \d+ px, b.*must stand still; a tripod"):
        fit_tone(*photographs((0, 7, 14, 21, 28)))


@pytest.mark.parametrize("change", ["other scenes", "exposures"])
def test_pictures_without_one_curve_are_refused(change):
    pictures, exposures, names = photographs()
    if change == "other scenes":
        pictures = [
            np.roll(picture, 50 * number, 0)[:, :: 1 - 2 * (number % 2)]
            for number, picture in enumerate(pictures)
        ]
    else:
        exposures = [1, 3, 4, 20, 25]
    with pytest.raises(ValueError, match=r"bracket: .*must (be pictures of one still scene|stand still)"):
        fit_tone(pictures, exposures, names)


BRACKET = Path(__file__).parents[4] / "shared/real/bracket_window"


@pytest.mark.slow
@pytest.mark.skipif(not BRACKET.is_dir(), reason="no photographs here")
def test_halves_of_a_real_bracket_predict_the_other():
    """Mean green within 2.5 of 255: its shutter is off by up to 2 %, which is worth 1."""
    shots = listed(BRACKET)
    files, exposures = [shot.file for shot in shots], np.array([shot.exposure for shot in shots])
    pictures = [decode(file)[::2, ::2] for file in files]
    green = np.stack([picture[..., 1].ravel() for picture in pictures])
    times, every = np.log(exposures), np.arange(len(files))
    for half in (every[::2], every[1::2]):
        tone = fit_tone(
            [pictures[each] for each in half], exposures[half], [files[each].name for each in half]
        )
        assert tone.left_out == ()
        assert np.nanmax(tone.response.residuals) < 5
        light = tone.response.light_of(green[half], times[half])
        known = np.isfinite(light)
        predicted = [tone.response.values_of(light[known] + time).mean() for time in times]
        assert predicted == pytest.approx(green[:, known].mean(1).tolist(), abs=2.5)


@pytest.mark.slow
@pytest.mark.skipif(not BRACKET.is_dir(), reason="no photographs here")
@pytest.mark.parametrize("wrong", [3, 4])
def test_of_real_pictures_the_one_two_stops_off_is_left_out(wrong):
    """Not one of its neighbours, without which the offsets agree as well, while the curve bends to the wrong one."""
    shots = listed(BRACKET)
    exposures = [shot.exposure * (4 if place == wrong else 1) for place, shot in enumerate(shots)]
    found = fit_tone([decode(shot.file) for shot in shots], exposures, [shot.name for shot in shots])
    assert [line.partition(":")[0] for line in found.left_out] == [shots[wrong].name]


@pytest.mark.parametrize(
    ("times", "rows", "why"),
    [
        ((1, 2), None, "2 exposures; must be 3 or more"),
        ((1, 1.05, 1.1), None, "in common"),
        ((1, 2, 4), "file\n1.png", "must have the columns file and exposure_s"),
        ((1, 2, 4), "", "the exposure time is missing; .* EXIF or to frames.csv"),
    ],
)
def test_what_is_no_bracket_is_refused(tmp_path, times, rows, why):
    folder = bracket(tmp_path / "bracket", lambda light: 0.3 * light, times=times)
    if rows is not None:
        (folder / "frames.csv").write_text(rows)
    if rows == "":
        (folder / "frames.csv").unlink()
    with pytest.raises(ValueError, match=why):
        measure_tone(folder)
