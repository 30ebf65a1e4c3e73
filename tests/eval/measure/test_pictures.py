"""Two pictures of one chart: alike but for the draw of noise, or not, and then in what."""

import json
import math
import re
from statistics import NormalDist

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.cli import main
from blurnoise_eval.measure.pictures import Quantity, compare, pair_of

from blurnoise import Camera, charts
from blurnoise.sensor.readout import read_out

CAMERA = Camera.preset("imx250").with_figures(black_level_dn=20.0)
SIZE = (257, 320)


def picture(seed, *, light=1.0, blur=0.0, camera=CAMERA):
    electrons = 5000.0 * light * charts.slanted_edge(*SIZE, angle_deg=5.0)
    if blur:
        electrons = torch.from_numpy(cv2.GaussianBlur(electrons[0, 0].numpy(), (0, 0), blur))[None, None]
    generator = torch.Generator().manual_seed(seed)
    dn = read_out(electrons.float(), camera, exposure_s=0.0, temperature_c=20.0, generator=generator)
    return dn[0, 0].numpy().astype(np.uint16)


def compared(first, second):
    return compare(pair_of(first, second, "linear", black_level=20.0, full_scale=4095.0))[0]


def verdicts(found):
    """By the kind of quantity, "agree" or how it differs; the worst of a kind."""
    told: dict[str, str] = {}
    for each in found:
        kind = each.name.split()[0].strip(",")
        if told.get(kind, "agree") == "agree":
            told[kind] = each.verdict
    return told


@pytest.mark.slow
def test_draws_of_one_camera_agree():
    """In one of twenty comparisons a quantity differs by chance: of eight pairs, in 4 or more once in 3000 times."""
    pairs = [compared(picture(2 * seed), picture(2 * seed + 1)) for seed in range(8)]
    assert sum(any(each.verdict != "agree" for each in found) for found in pairs) < 4
    names = [each.name for each in pairs[0]]
    assert names[0] == "mean"
    for kind, count in (("noise at", 2), ("MTF50", 1)):
        assert sum(name.startswith(kind) for name in names) == count


def test_texture_rules_no_verdict():
    """Texture of the noise's own variance in both pictures, one pixel apart: half of what is compared is noise, and
    read noise of 5 % more shows as half of that. A picture without texture tells."""
    random = np.random.default_rng(1)
    texture = 32 * random.standard_normal(SIZE)
    for of_texture, verdict, share in ((1.0, "cannot tell", 0.5), (0.0, "agree", 1.0)):
        pictures = [
            1000 + of_texture * np.roll(texture, place, 1) + 32 * random.standard_normal(SIZE)
            for place in (0, 1)
        ]
        pair = pair_of(*(np.round(each).astype(np.uint16) for each in pictures), "linear", full_scale=4095.0)
        found, notes = compare(pair)
        noise = next(each for each in found if each.name.startswith("noise"))
        assert noise.noise_share == pytest.approx(share, abs=0.06)  # a shift loses 1 of 16 columns
        assert noise.verdict == verdict
        assert any("texture" in note for note in notes) == (verdict == "cannot tell")


def test_noise_is_the_cameras():
    """Levels of 250 squares of 16 x 16 px: a deviation to 0.3 %; the edge's own squares are left out."""
    noise = [each for each in compared(picture(0), picture(1)) if each.name.startswith("noise at")]
    for each, reflectance in zip(noise, (0.1, 0.8), strict=True):
        gain = CAMERA.sensor.system_gain_dn_per_e
        expected = gain * np.sqrt(5000 * reflectance + CAMERA.sensor.dark_variance_dn2() / gain**2) / 4075
        assert each.simulated == pytest.approx(expected, rel=0.02)
        assert each.real == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_what_differs_is_told_apart():
    simulated = picture(0)
    darker = verdicts(compared(simulated, picture(1, light=0.8)))
    assert darker["mean"].startswith("differs by -")
    assert darker["noise"].startswith("differs by -")
    assert darker["MTF50"] == "agree"
    blurred = verdicts(compared(simulated, picture(1, blur=1.0)))
    assert blurred["MTF50"].startswith("differs by -")
    assert blurred["mean"] == "agree"
    noisier = compared(simulated, picture(1, camera=CAMERA.with_figures(read_noise_e=30.0)))
    darkest = next(each for each in noisier if each.name.startswith("noise"))
    assert darkest.difference > 0.1
    assert verdicts(noisier)["mean"] == "agree"


@pytest.mark.slow
def test_chance_is_as_wide_as_differences_are():
    """Differences in standard deviations, of 12 pairs: a spread of 1 within a factor of 1.6, kind by kind. Chance is
    what one of n quantities exceeds in 5 % of comparisons: a normal's 1 - 0.025 / n."""
    deviations: dict[str, list[float]] = {}
    for seed in range(12):
        quantities = compared(picture(50 + 2 * seed), picture(51 + 2 * seed))
        most = NormalDist().inv_cdf(1 - 0.025 / len(quantities))
        for each in quantities:
            deviations.setdefault(each.name.split()[0], []).append(most * each.difference / each.chance)
    for kind, found in deviations.items():
        assert 1 / 1.6 < np.sqrt(np.mean(np.square(found))) < 1.6, kind


def test_what_cannot_be_told():
    assert Quantity("x", "", 0.0, 1.0, 0.1).verdict == "cannot tell"
    assert Quantity("x", "", 1.0, 2.5, 0.1).verdict == "differs by +150 %"
    assert [Quantity("x", "", 0.0, 0.0, each).cells()[3] for each in (0.1, math.nan, math.inf)] == [
        "±10 %",
        "-",
        "-",
    ]
    _, notes = compare(pair_of(np.full(SIZE, 500, np.uint16), np.full(SIZE, 500, np.uint16)))
    assert any("sharpness is not compared" in note for note in notes)
    assert any("noise is not compared" in note for note in notes)


def test_pictures_that_do_not_go_together():
    said = "simulated, real: are 320 x 257 px, 16 bits and"
    for first, second, why in (
        (picture(0), np.zeros((257, 321), np.uint16), f"{said} 321 x 257 px, 16 bits; must have the same"),
        (picture(0), np.zeros(SIZE, np.uint8), f"{said} 320 x 257 px, 8 bits; must have the same"),
        (np.zeros((63, 99), np.uint8), np.zeros((63, 99), np.uint8), "at least 64 x 64"),
    ):
        with pytest.raises(ValueError, match=re.escape(why)):
            pair_of(first, second)


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    for name, seed in (("a", 0), ("b", 1)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture(seed))
    pictures = [str(tmp_path / name) for name in ("a.png", "b.png")]
    words = ["compare", *pictures, "--black-level", "20", "--full-scale", "4095"]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines()[:6])) <= 80
    assert "agree" in shown
    assert main([*words, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["quantities"]
    assert rows[0]["quantity"] == "mean"
    assert len(rows) == 4
    assert main([*words[:2], str(tmp_path / "missing.png")]) == 2
    assert main([*words, "--srgb", "--linear"]) == 2
    assert capsys.readouterr().err.count("\n") == 2


@pytest.mark.parametrize(
    ("real", "chance", "verdict"),
    [
        (0.85, 0.2, "agree"),
        (0.75, 0.2, "differs by -25 %"),
        (0.3, 2.0, "agree"),
        (1e-6, 2.0, "differs by -100 %"),
    ],
)
def test_no_chance_makes_any_loss_agree(real, chance, verdict):
    assert Quantity("noise", "", 1.0, real, chance).verdict == verdict
