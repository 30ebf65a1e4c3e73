"""Exposures of photographs: as EXIF and texts have them, and the light that follows."""

import math
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import decode
from blurnoise_eval.datasets.exif import exif_exposure
from blurnoise_eval.datasets.taken import Taken, exif_text
from commands import main, told
from PIL import Image

from blurnoise import Camera, photoelectrons


def photograph(path, time=1 / 30, iso=200, f_number=2.8, kind=None):
    """A ramp as a JPEG with these in its EXIF; None: left out."""
    exif, values = Image.Exif(), {33434: time, 34855: iso, 33437: f_number, 34864: kind}
    exif.get_ifd(0x8769).update({tag: value for tag, value in values.items() if value is not None})
    ramp = np.repeat(np.arange(0, 256, 4, dtype=np.uint8)[None], 48, 0)
    Image.fromarray(np.repeat(ramp[..., None], 3, 2)).save(path, exif=exif, quality=98)
    return path


def test_the_light_of_white_is_that_of_iso_12232():
    """H = 10 / S lx s at the value 118, and 0.65 L T / N² of a luminance L; 18 % of white in sRGB."""
    luminance = 10 / 200 * 2.8**2 / (0.65 / 30)
    srgb_18 = ((118 / 255 + 0.055) / 1.055) ** 2.4
    assert Taken.parse("1/30,200,f2.8").lux("srgb") == pytest.approx(math.pi * luminance / srgb_18)
    assert Taken.parse("1/30,200,f2.8").lux("linear") == pytest.approx(
        math.pi * luminance / srgb_18
    )  # not coded


@pytest.mark.parametrize(("kind", "tag"), [(1, 34865), (2, 34866), (3, 34867), (None, 34866)])
def test_an_iso_beyond_16_bits_is_in_another_tag(tmp_path, kind, tag):
    """ISO has 16 bits, and 65535 where what SensitivityType names is more; of no kind it is not known."""
    path = photograph(tmp_path / "a.jpg", iso=65535, kind=kind)
    with Image.open(path) as opened:
        exif, picture = opened.getexif(), opened.copy()
    exif.get_ifd(0x8769)[tag] = 102400
    picture.save(path, exif=exif)
    assert exif_exposure(path).iso == (102400 if kind else pytest.approx(math.nan, nan_ok=True))


def test_exif_has_it_or_not(tmp_path):
    taken = Taken.of_file(photograph(tmp_path / "a.jpg", kind=2))
    assert taken is not None
    assert taken.text == "1/30 s, ISO 200 (REI), f/2.8"
    assert Taken.of_file(photograph(tmp_path / "b.jpg", iso=None)) is None
    assert Taken.of_file(photograph(tmp_path / "c.jpg", time=0.0)) is None
    (tmp_path / "d.jpg").write_bytes(b"no picture")
    assert Taken.of_file(tmp_path / "d.jpg") is None
    photograph(tmp_path / "e.jpg", time=1 / 60)
    lux = Taken.parse("1/30,200,2.8").lux("srgb")
    text = exif_text([tmp_path / f"{name}.jpg" for name in "abcde"], "srgb")
    assert text == f"2 of 5 photographs, taken in {lux:.2g} to {2 * lux:.2g} lux (median {2 * lux:.2g})"


@pytest.mark.parametrize("text", ["1/30,200", "1/0,200,f2", "a,200,2", "1e400,100,2"])
def test_another_text_is_a_line(text):
    with pytest.raises(ValueError, match=r"taken = .*must be time, ISO and f-number, such as 1/30,200,f2.8"):
        Taken.parse(text)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("1/30,1e9,2.8", r"iso = 1e\+09: must be 1 to 1e\+07"),
        ("1e-9,200,2.8", r"exposure_s = 1e-09: must be 1e-06 to 100000"),
        ("1/30,200,0", r"f_number = 0: must be 0.5 to 1000"),
        ("1/30,0,2", r"iso = 0: must be 1 to"),
        ("-1,200,2", r"taken = '-1,200,2': exposure_s = -1: must be 1e-06"),
    ],
)
def test_exposures_of_no_camera_are_refused_by_their_own_name(text, named):
    with pytest.raises(ValueError, match=named):
        Taken.parse(text)


@pytest.mark.parametrize("iso", [100, 3200])
def test_a_photograph_taken_again_keeps_its_values_and_darkens_with_time(tmp_path, capsys, iso):
    """At its own time within 2 of 255; at a quarter, light a quarter: a value less by what the curve has for it."""
    path = photograph(tmp_path / "photo.jpg", iso=iso)
    ramp = decode(path).mean((0, 2))
    means = []
    for time in (1000 / 30, 250 / 30):
        words = [
            "-o",
            tmp_path / "out.png",
            "--exposure-ms",
            time,
            "--picture-tone",
            "srgb",
            "--fidelity",
            "full",
        ]
        facts = told(capsys, "simulate", path, *words)
        means.append(decode(tmp_path / "out.png").reshape(48, 64, -1).mean((0, 2)))
    assert facts["taken"].startswith(f"1/30 s, ISO {iso}, f/2.8: in ")
    assert np.abs(means[0] - ramp)[4:60].max() < 3
    light = ((ramp / 255 + 0.055) / 1.055) ** 2.4 / 4
    assert np.abs(means[1] - 255 * (1.055 * light ** (1 / 2.4) - 0.055))[16:].max() < 3


def test_a_named_camera_stays_and_lux_prevail(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photograph(Path("photo.jpg"))
    words = ["simulate", "photo.jpg", "-o", "out.png", "--exposure-ms", 2, "--picture-tone", "srgb"]
    lux = Taken.parse("1/30,200,2.8").lux("srgb")
    by_exif = told(capsys, *words, "--camera", "imx250")
    assert by_exif["white_electrons"] == pytest.approx(photoelectrons(Camera.preset("imx250"), lux, 0.002))
    assert "taken" not in told(capsys, *words, "--camera", "imx250", "--lux", 100)
    other = told(capsys, *words, "--camera", "imx250", "--taken", "1/60,200,f2.8")
    assert other["white_electrons"] == pytest.approx(2 * by_exif["white_electrons"])
    assert main([*map(str, words), "--lux", "100", "--taken", "1/30,200,f2.8"]) == 2
    assert "--taken, --lux: must not be combined" in capsys.readouterr().err


def test_gain_is_the_photograph_s_unless_it_is_stated(tmp_path, capsys):
    """0 dB is as good a statement as any."""
    words = ["simulate", photograph(tmp_path / "photo.jpg", iso=3200), "-o", tmp_path / "out.png"]
    assert told(capsys, *words)["gain_db"] > 10
    assert told(capsys, *words, "--gain", 0)["gain_db"] == 0


def test_an_iso_beyond_the_camera_s_gain_is_taken_all_the_same(tmp_path, capsys):
    words = ["simulate", photograph(tmp_path / "photo.jpg"), "-o", tmp_path / "out.png"]
    assert told(capsys, *words, "--taken", "1/30,409600,2.8")["gain_db"] > 48


def test_a_part_of_an_exposure_is_named_with_what_it_lacks(tmp_path, capsys):
    path = photograph(tmp_path / "photo.jpg", f_number=None)
    assert main(["simulate", str(path), "-o", str(tmp_path / "out.png")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "photo.jpg: its EXIF lacks the f-number, so the light is assumed: 100 lux" in said
