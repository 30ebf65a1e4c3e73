"""``blurnoise measure``: numbers against closed forms, codings, what is withheld, and bad input."""

import csv
import json
import math
from functools import cache

import charts_of_squares as chart
import cv2
import numpy as np
import pandas as pd
import pytest
import torch
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.measure.edges import EDGE_METRICS, estimate_text
from blurnoise_eval.measure.find_edges import UNUSABLE, find_edges
from blurnoise_eval.measure.linear import LinearPicture
from edge_cases import Draw, Setting
from torch import Tensor

from blurnoise import charts
from blurnoise.blur.convolution import motion_blur
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.metrics import Flag, information
from blurnoise.metrics.sharpness import contrast_sensitivity
from blurnoise.metrics.values import Estimate

# of the pictures of 12 bits below, DN; their edges go from 400 to 3200 above black
BLACK, STEP = (40.0, 2800.0)


def raw(path, linear, noise_dn=0.0):
    """A picture of 12 bits: reflectance 0.1 to 0.8 as 400 to 3200 DN above black, with white noise."""
    generator = torch.Generator().manual_seed(7)
    dn = 4000 * linear[0, 0].double() + BLACK
    dn = dn + noise_dn * torch.randn(dn.shape, generator=generator, dtype=torch.float64)
    write_picture(path, dn.round().clamp(0, 4095).numpy().astype(np.uint16))
    return path


NAMES = [metric.name for metric in EDGE_METRICS]
RAW = ("--black-level", "40", "--full-scale", "4095")


def measured(capsys, *arguments):
    assert main(["measure", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


def test_numbers_are_the_closed_forms(tmp_path, capsys):
    """Motion of 4.4 px, noise of 28 DN: what both leave, each within its interval's width of the closed form."""
    noise_dn = STEP / 100
    image = motion_blur(charts.slanted_edge(200, 200), [[4.4, 0.0]])
    said = measured(capsys, raw(tmp_path / "edge.png", image, noise_dn), *RAW, "--target", "40,0.1")
    (row,) = said["regions"]
    frequency = torch.linspace(0, 0.5, 501, dtype=torch.float64)
    cos, sin = math.cos(math.radians(5)), math.sin(math.radians(5))
    sinc = torch.sinc
    response = sinc(4.4 * cos * frequency) * sinc(cos * frequency) * sinc(sin * frequency)
    variance = noise_dn**2 + 1 / 12
    bits = information.shannon_capacity_radial(
        frequency, power=response**2, signal_pp=STEP, noise_variance=variance
    )
    both = (response * response[:, None]) ** 2  # the only edge there is: the same both ways
    square = information.shannon_capacity_square(
        frequency, frequency, power=both, signal_pp=STEP, noise_variance=variance
    )
    fine = torch.linspace(0, 1, 1001, dtype=torch.float64)
    seen, weights = (sinc(4.4 * cos * fine) * sinc(cos * fine)).abs(), contrast_sensitivity(60 * fine)
    quanta = information.neq(both, mean_signal=3200.0, noise_power_spectrum=variance)
    expected = {
        "mtf50": chart.mtf50(5.0, 4.4),
        "mtf50p": chart.mtf50(5.0, 4.4),
        "mtf_nyquist_2": abs(float(response[250])),
        "mtf_nyquist": abs(float(response[500])),
        "acutance": float(seen @ weights / weights.sum()),
        "cnr": STEP / math.sqrt(variance),
        "edge_snr_db": 20 * math.log10(STEP / math.sqrt(variance)),
        "michelson": STEP / 3600,
        "sic_radial": float(bits),
        "sic_square": float(square),
        "neq_0": 3200**2 / variance,
        "neq_integral": float(information.square_integral(frequency, frequency, quanta)),
    }
    assert [*expected, "snri"] == NAMES
    for name, value in expected.items():
        width = row[f"{name}_high"] - row[f"{name}_low"]
        assert 0 < width < 0.5 * value
        assert abs(row[name] - value) < width, name
    # Without blur it were contrast x level x side / noise; 4 px of blur on 40 px take some of it.
    ideal = 0.1 * 1800 * 40 / math.sqrt(variance)
    assert 0.85 * ideal < row["snri_low"] < row["snri"] < row["snri_high"] < ideal
    assert (row["second_region"], row["flags"]) == (None, "")
    assert (row["orientation"], row["bright_side"]) == ("vertical", "right")
    assert row["angle_deg"] == pytest.approx(5, abs=0.01)
    assert (said["unit"], said["mode"]) == ("DN", "exact")


@pytest.mark.slow
def test_codings_agree_where_they_are_right(tmp_path, capsys):
    """8 bits sRGB, its colour twin and 16 bits linear hold one edge; coded numbers taken as linear have a flag."""
    light = motion_blur(charts.slanted_edge(120, 120), [[3.0, 0.0]])
    coded = (255 * srgb_from_linear(light)).round().byte().numpy()[0, 0]
    write_picture(tmp_path / "grey.png", coded)
    write_picture(tmp_path / "rgb.png", np.stack([coded] * 3, axis=-1))
    write_picture(tmp_path / "16.png", (65535 * light).round().numpy()[0, 0].astype(np.uint16))
    write_picture(tmp_path / "16s.png", (65535 * srgb_from_linear(light)).numpy()[0, 0].astype(np.uint16))
    cases = {"grey.png": "sRGB", "rgb.png": "luminance", "16.png": "linear", "16s.png --coding=srgb": ""}
    for given, word in cases.items():
        name, *coding = given.split()
        said = measured(capsys, tmp_path / name, *coding)
        assert said["regions"][0]["mtf50"] == pytest.approx(chart.mtf50(5.0, 3.0), rel=0.003)
        assert said["regions"][0]["michelson"] == pytest.approx(0.7 / 0.9, rel=0.01)
        assert word in " ".join(said["notes"])
    (wrong,) = measured(capsys, tmp_path / "grey.png", "--coding", "linear")["regions"]
    assert "tone curve" in wrong["flags"]
    assert wrong["michelson"] < 0.5


def test_withheld_numbers_are_empty_and_say_why(tmp_path, capsys):
    """A clipped edge, a corner, even ground, beside a good edge: in JSON, in CSV, in the table, in the figure."""
    image = chart.squares()[..., :165, :200]
    image[..., 40:130, 150:] += 0.25  # beyond full scale beside the right-hand edge
    path, out = raw(tmp_path / "chart.png", image, 20.0), tmp_path / "out"
    rois = ("80,20,40,50", "110,60,70,50", "30,20,60,60", "2,2,30,30")
    asked = [path, *RAW, *(word for roi in rois for word in ("--roi", roi))]
    rows = measured(capsys, *asked, "-o", out)["regions"]
    flags = [(), (Flag.CLIPPED,), (Flag.TWO_EDGES,), (Flag.NO_EDGE,)]
    table = pd.read_csv(out / "edges.csv")
    for row, wanted, (_, read) in zip(rows, flags, table.iterrows(), strict=True):
        assert all(flag.value in row["flags"] for flag in wanted)
        numbers = [row[name + end] for name in NAMES for end in ("", "_low", "_high")]
        assert [value is None for value in numbers] == [bool(wanted)] * len(numbers)
        assert [math.isnan(read[name]) for name in NAMES] == [bool(wanted)] * len(NAMES)
        assert read["mtf50"] == (row["mtf50"] if not wanted else pytest.approx(math.nan, nan_ok=True))
    assert list(csv.DictReader((out / "edges.csv").open()))[1]["cnr"] == ""
    assert main(["measure", *map(str, asked)]) == 0
    out_text, err = capsys.readouterr()
    assert "nan" not in out_text
    dashes = [word for line in out_text.splitlines() for word in line.split() if word == "-"]
    assert len(dashes) >= 3 * len(NAMES)
    assert f"2: {Flag.CLIPPED.value}" in " ".join(out_text.split())
    assert err == (
        "the picture has 16 bits and is read as linear (use --coding srgb if it is sRGB-coded)\n"
        "a tone curve that is symmetric about the middle of an edge cannot be detected; --oecf FILE removes it\n"
    )
    assert cv2.imread(str(out / "edges.png")).shape[1] > 800


def test_no_noise_leaves_no_number_that_would_have_no_bound(tmp_path, capsys):
    """Of sRGB 8 bits the levels are fractions, whose rounding made a CNR of 1e31."""
    assert main(["chart", "slanted-edge", "-o", str(tmp_path / "edge.png")]) == 0
    capsys.readouterr()
    (row,) = measured(capsys, tmp_path / "edge.png")["regions"]
    assert row["mtf50"] == pytest.approx(chart.mtf50(5.0), rel=0.005)
    for name in ("cnr", "edge_snr_db", "sic_radial", "sic_square", "neq_0", "neq_integral", "snri"):
        assert row[name] is row[f"{name}_low"] is row[f"{name}_high"] is None, name
    assert "no noise" in row["flags"]


def test_readings_as_text():
    assert estimate_text(Estimate(0.098823, 0.098112, 0.09951)) == "0.09882 (0.0981–0.0995)"
    assert estimate_text(Estimate(5.4152, 4.9179, 5.9964, frozenset({"sharpened"}))) == "5.415? (4.92–6)"
    assert estimate_text(Estimate(5415.27, 4917.9, 5996.4)) == "5415 (4918–5996)"
    assert estimate_text(Estimate(math.nan)) == estimate_text(Estimate(math.inf, 1.0, math.inf)) == "-"


def test_iso_is_another_mode(tmp_path, capsys):
    path = raw(tmp_path / "edge.png", charts.slanted_edge(100, 100), 20.0)
    exact, iso = (measured(capsys, path, *RAW, "--mode", mode) for mode in ("exact", "iso"))
    assert iso["mode"] == "iso"
    assert iso["regions"][0]["mtf50"] != exact["regions"][0]["mtf50"]
    assert iso["regions"][0]["mtf50"] == pytest.approx(exact["regions"][0]["mtf50"], rel=0.05)


# --- edges that deceive ------------------------------------------------------


def test_a_grey_scale_takes_a_tone_curve_out(tmp_path, capsys):
    """An S that raises MTF50 by 18 %: with the scale's 21 fields it is back within 2 %."""
    at, light = Setting(sigma_px=1.0, offset_px=(0.3, 0.1), noise=0.002), np.linspace(0, 1, 21)

    def curve(value):
        return 0.5 + 0.45 * np.tanh(3 * (value - 0.5)) / math.tanh(1.5)

    numbers = 65535 * curve(light)
    scale = tmp_path / "scale.csv"
    scale.write_text(
        "number,light\n" + "".join(f"{a:.3f},{b:.3f}\n" for a, b in zip(numbers, light, strict=True))
    )
    path = tmp_path / "edge.png"
    write_picture(path, (65535 * curve(at.noisy(at.edge(), Draw.of(1)).numpy())).round().astype(np.uint16))
    roi = ("--roi", "0,0,120,100")
    (bent,), (right,) = (measured(capsys, path, *roi, *more)["regions"] for more in ((), ("--oecf", scale)))
    assert bent["mtf50"] > 1.15 * at.mtf50
    assert right["mtf50"] == pytest.approx(at.mtf50, rel=0.02)
    assert right["flags"] == ""


# --- slanted edges found in a picture ---


def found(image, full_scale=1.0, black_level=0.0):
    return find_edges(LinearPicture(image[0].double(), full_scale, black_level))


def noise(image, deviation):
    return image + deviation * torch.randn(image.shape, generator=torch.Generator().manual_seed(2))


BLURS = {  # px of motion to the right, noise, and what MTF50 may be off
    "sharp": (0.0, 0.0, 0.004),
    "noisy": (0.0, 0.02, 0.08),
    "moved": (8.0, 0.0, 0.004),
    "moved far, noisy": (20.0, 0.01, 0.04),
}


@cache
def blurred(name):
    """The chart of squares, and its regions."""
    length, deviation, _ = BLURS[name]
    image = noise(motion_blur(chart.squares(), [[length, 0.0]]), deviation)
    return image, found(image).rois


@pytest.mark.slow
@pytest.mark.parametrize("name", BLURS)
def test_every_edge_of_a_chart_is_found_and_gives_the_closed_form(name):
    """Four sides of four squares: their angles to 0.2°, MTF50 to 0.4 %, with noise to four standard errors."""
    length, _, error = BLURS[name]
    image, regions = blurred(name)
    assert len(regions) == 16
    assert [top for _, top, _, _ in regions] == sorted(top for _, top, _, _ in regions)
    angles = []
    for roi in regions:
        edge = LinearPicture(image[0].double(), 1.0).edge(roi)
        assert not edge.flags & UNUSABLE
        turn = (edge.angle_deg - chart.TILT_DEG + 45) % 90 - 45
        assert abs(turn) < 0.2
        angles.append(round((edge.angle_deg - chart.TILT_DEG) / 90) % 4)
        assert edge.mtf50 == pytest.approx(chart.mtf50(edge.angle_deg, length), rel=error)
    assert sorted(angles) == sorted([0, 1, 2, 3] * 4)


@pytest.mark.parametrize("angle_deg", [3.0, 12.0, 26.565, 95.0, 184.0, -80.0])
def test_an_edge_alone_has_the_whole_picture(angle_deg):
    assert found(charts.slanted_edge(160, 180, angle_deg=angle_deg)).rois == [(0, 0, 180, 160)]


def test_wide_blur_under_noise_shows_at_coarser_scales():
    image = motion_blur(charts.slanted_edge(200, 200, dark=0.3, bright=0.6), [[30.0, 0.0]])
    assert found(noise(image, 0.03)).rois == [(0, 0, 200, 200)]


NOT_FOUND: dict[str, tuple[Tensor, Flag | None]] = {
    "upright": (charts.slanted_edge(120, 160, angle_deg=0.0), Flag.TOO_FEW_PHASES),
    "clipped": ((chart.squares() * 1.4).clamp(max=1), Flag.CLIPPED),
    "steep": (charts.slanted_edge(120, 160, angle_deg=40.0), None),
    "noise": (noise(charts.flat_patch(90, 120), 0.02), None),
    "small": (charts.slanted_edge(20, 20), None),
    "one pixel": (charts.slanted_edge(1, 1), None),
}


@pytest.mark.parametrize(("image", "reason"), NOT_FOUND.values(), ids=NOT_FOUND)
def test_what_cannot_be_measured_is_not_found(image, reason):
    detected = found(image)
    assert detected.rois == []
    assert set(detected.rejected) == ({reason} if reason else set())
