"""``blurnoise measure --of star, glare, flicker``: captured charts whose numbers are known, and bad input."""

import json
import math

import cv2
import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import write_picture
from scipy.ndimage import gaussian_filter

from blurnoise import charts

RAW = ("--black-level", "100", "--full-scale", "4095")


def measured(capsys, *arguments):
    assert main(["measure", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


def raw(path, light):
    """12 bits: light 1 is 3000 DN above a black level of 100."""
    write_picture(path, np.rint(100 + 3000 * light).clip(0, 4095).astype(np.uint16))
    return path


@pytest.mark.parametrize("cycles", [36, 60])
def test_a_rendered_star_that_is_blurred_has_the_gaussians_mtf50(tmp_path, capsys, cycles):
    """Pixel and Gaussian of 1.2 px; the outer ring, of which they leave 0.94 (36) or 0.85 (60), counts as 1."""
    light = charts.siemens_star(300, height_px=320, width_px=400, cycles=cycles)[0, 0].double().numpy()
    picture = raw(tmp_path / "star.png", gaussian_filter(light, 1.2, truncate=8))
    said = measured(
        capsys,
        picture,
        "--of",
        "star",
        "--roi",
        "50,10,300,300",
        *RAW,
        "-o",
        tmp_path / "s",
    )
    found = said["metrics"]["MTF50 of the star, cycles/px"]
    assert found["flags"] == []
    assert found["low"] < found["value"] < found["high"]
    frequency = np.linspace(0.01, 0.4, 4000)
    turn = np.linspace(0, 2 * math.pi, 720, endpoint=False)[:, None]
    pixel = (np.sinc(frequency * np.cos(turn)) * np.sinc(frequency * np.sin(turn))) ** 2
    power = pixel.mean(0) * np.exp(-((2 * math.pi * 1.2 * frequency) ** 2))
    outer = said["rows"][0]["frequency_cycles_px"]
    half = frequency[power < np.interp(outer, frequency, power) / 4][0]
    assert found["value"] == pytest.approx(half, rel=0.01)
    for row in said["rows"]:
        relative = np.interp(row["frequency_cycles_px"], frequency, power) / np.interp(
            outer, frequency, power
        )
        assert row["frequency_cycles_px"] > 0.35 or row["sfr"] == pytest.approx(math.sqrt(relative), abs=0.02)
    assert json.loads((tmp_path / "s" / "star.json").read_text()) == said
    clipped = measured(capsys, raw(tmp_path / "c.png", 2 * light), "--of", "star", *RAW)
    assert clipped["metrics"]["MTF50 of the star, cycles/px"]["flags"] == ["clipped"]


def test_a_star_that_does_not_fill_the_region_asks_for_one(tmp_path, capsys):
    """`chart`'s own, of 100 px in a picture of 320."""
    path = str(tmp_path / "star.png")
    assert main(["chart", "siemens-star", "-o", path]) == 0
    assert main(["measure", path, "--of", "star"]) == 0
    assert "state it with --roi X,Y,WIDTH,HEIGHT" in capsys.readouterr().err
    assert main(["measure", path, "--of", "star", "--roi", "110,110,100,100"]) == 0
    said = capsys.readouterr()
    assert "--roi X" not in said.err
    assert "MTF50 of the star, cycles/px: 0.6" in said.out


def test_glare_is_the_trap_over_the_field_above_black(tmp_path, capsys):
    light = np.full((100, 160), 0.8)
    light[40:60, 70:90] = 0.02
    noise = np.random.default_rng(1).normal(0, 0.004, light.shape)
    regions = ("--roi", "72,42,16,16", "--roi", "10,10,50,50")
    found = measured(capsys, raw(tmp_path / "g.png", light + noise), "--of", "glare", *regions, *RAW)
    number = found["metrics"]["veiling glare"]
    # 256 pixels of 0.004 against 0.8: a standard error of 0.0003
    assert number["value"] == pytest.approx(0.025, abs=0.001)
    assert number["high"] - number["low"] == pytest.approx(4 * 0.004 / 16 / 0.8, rel=0.2)
    clipped = measured(capsys, raw(tmp_path / "c.png", 2 * light), "--of", "glare", *regions, *RAW)
    assert clipped["metrics"]["veiling glare"] == {
        "value": None,
        "low": None,
        "high": None,
        "flags": ["clipped", "noiseless"],
    }


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_flicker_of_a_clip_is_the_one_it_was_made_with(tmp_path, capsys, kind):
    """Lit in two of five frames: 200 and 60 beside 20 without; 60 is near the mean, 64."""
    levels = [200, 20, 20, 60, 20] * 8
    frames = np.full((len(levels), 48, 64, 3), 20, np.uint8)
    frames[:, 8:32, 8:32] = np.array(levels, np.uint8)[:, None, None, None]
    clip = tmp_path / ("clip" if kind == "folder" else "clip.avi")
    if kind == "folder":
        clip.mkdir()
        for number, frame in enumerate(frames):
            write_picture(clip / f"{number:03d}.png", frame)
    else:
        video = cv2.VideoWriter(str(clip), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
        for frame in frames:
            video.write(frame)
        video.release()
    where = ("--of", "flicker", "--coding", "linear", "--roi", "12,12,16,16", "--roi", "44,12,16,16")
    said = measured(capsys, clip, *where, "-o", tmp_path / "f")
    found = {title: number["value"] for title, number in said["metrics"].items()}
    # JPEG moves a flat area by 1 of 255 at most
    assert found["flicker modulation index"] == pytest.approx(180 / 220, abs=0.01)
    assert found["flicker detection index"] == pytest.approx(0.4)
    assert found["modulation mitigation probability"] == pytest.approx(0.2)
    assert [row["lamp"] for row in said["rows"]] == pytest.approx(levels, abs=1.5)
    assert len((tmp_path / "f" / "flicker.csv").read_text().splitlines()) == 41


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--of", "star", "--roi", "0,0,100,100", "--roi", "0,0,100,100"), "roi: 2 regions; must be one"),
        (("--of", "glare", "--roi", "0,0,10,10"), "roi: 1 regions; must be two"),
        (("--of", "flicker",), "roi: 0 regions; must be one"),
        (("--of", "flicker", "--roi", "0,0,10,10"), "must be a video, or a folder, of two frames"),
        (("--of", "glare", "--roi", "0,0,10,10", "--roi", "0,0,999,10"), "must lie inside the picture"),
        (("--of", "star", "--target", "10,0.1"), "target: needs --of edges"),
    ],
)  # fmt: skip
def test_bad_input_is_named(tmp_path, capsys, arguments, message):
    picture = raw(tmp_path / "p.png", np.full((120, 120), 0.5))
    assert main(["measure", str(picture), *arguments]) == 2
    assert message in capsys.readouterr().err
