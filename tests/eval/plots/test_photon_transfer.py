"""Cameras at the command: the table, a file's way through it, and the photon transfer against the model."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.plots import photon_transfer as cameras
from commands import main

from blurnoise import Camera
from blurnoise.optics.camera import PRESETS
from blurnoise.sensor import readout as sensor

Output = pytest.CaptureFixture[str]
DARK = replace(  # every noise there is, and a gain at which rounding is white
    PRESETS["imx250"], name="dark", dark_current_e_s=2000.0, prnu=0.02, dsnu_e=4.0, black_level_dn=40.0
)
N = cameras.FRAME_PX**2


def told(capsys: Output, *arguments: object) -> Any:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: Output, named: str, *arguments: object) -> None:
    assert main(list(map(str, arguments))) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert named in err


def deviations(camera: Camera, model: Camera) -> np.ndarray[Any, Any]:
    """Measured less expected variance of ``camera`` by ``model``, in standard errors of each level.

    The difference of two frames has the excess kurtosis of one, at most 1 / N of N photo-electrons, halved;
    half its variance over n pixels scatters by sqrt((2 + kurtosis) / n) of itself.
    """
    points = cameras.measured(camera)
    whole = cameras.unclipped(camera, points.photo_e)
    line = cameras.expected(model, points.photo_e)
    kurtosis = 0.5 / np.maximum(points.photo_e, camera.read_noise_e**2)
    error = line.variance_dn2 * np.sqrt((2 + kurtosis) / N)
    assert whole.sum() >= 10
    return ((points.variance_dn2 - line.variance_dn2) / error)[whole]


@pytest.mark.slow
@pytest.mark.parametrize("camera", [*PRESETS.values(), DARK], ids=lambda camera: camera.name)
def test_measured_points_lie_on_the_models_line(camera: Camera) -> None:
    """Five standard errors; a read noise, or a gain, 5 % off lies outside them."""
    assert np.abs(deviations(camera, camera)).max() < 5
    wrong_gain = replace(camera, system_gain_dn_per_e=1.05 * camera.system_gain_dn_per_e, black_level_dn=0.0)
    assert np.abs(deviations(camera, wrong_gain)).max() > 5
    if camera.name != "lin2024":  # whose dark clips
        noisier = replace(camera, read_noise_e=1.05 * camera.read_noise_e)
        assert np.abs(deviations(camera, noisier)).max() > 5


@pytest.mark.parametrize("camera", [*PRESETS.values(), DARK], ids=lambda camera: camera.name)
def test_means_follow_the_gain(camera: Camera) -> None:
    """The mean of 2n pixels scatters by sqrt(var / 2n), that of the dark as well."""
    points = cameras.measured(camera)
    line = cameras.expected(camera, points.photo_e)
    whole = cameras.unclipped(camera, points.photo_e)
    if not whole[0]:  # a dark that clips has no mean to count from
        assert camera.name == "lin2024"
        return
    error = np.sqrt((line.variance_dn2 + line.variance_dn2[0]) / (2 * N))
    error += camera.prnu * line.signal_dn / math.sqrt(N)  # the pattern's own mean
    assert np.all(np.abs(points.signal_dn - line.signal_dn)[whole] <= 5 * error[whole])


def test_gain_and_read_noise_are_read_off() -> None:
    """To 1 %: 24 levels of 0.55 % each, and a dark variance of 0.55 %."""
    for camera in (PRESETS["imx250"], PRESETS["ar0237"], DARK):
        gain, read_e = cameras.fitted(camera, cameras.measured(camera))
        assert gain == pytest.approx(camera.system_gain_dn_per_e, rel=0.01)
        assert read_e == pytest.approx(camera.read_noise_e, rel=0.04 if camera is DARK else 0.01)
    one_bit = replace(
        PRESETS["imx250"], bit_depth=1, system_gain_dn_per_e=0.1, black_level_dn=0.0, full_well_e=20.0
    )
    assert all(map(math.isnan, cameras.fitted(one_bit, cameras.measured(one_bit))))


def test_levels_reach_from_the_dark_beyond_saturation() -> None:
    points = cameras.measured(PRESETS["imx250"])
    assert len(points.photo_e) == cameras.LEVELS == 32
    assert points.photo_e[0] == 0
    assert np.all(np.diff(points.photo_e) > 0)
    assert points.photo_e[-1] > PRESETS["imx250"].saturation_e
    assert points.variance_dn2[-1] < 0.01 * points.variance_dn2.max()
    np.testing.assert_array_equal(points, cameras.measured(PRESETS["imx250"]))


@pytest.mark.parametrize("name", ["imx250", "imx249", "mt9m034"])
def test_snr_is_one_at_the_threshold(name: str) -> None:
    """At saturation less the dynamic range; the SNR of n pixels scatters by sqrt(1.5 / n), the dark's 1 / n."""
    camera = PRESETS[name]
    threshold_e = camera.saturation_e / 10 ** (camera.dynamic_range_db / 20)
    dark, lit = (
        sensor.read_out(
            torch.full((1, 1, 600, 600), level), camera, exposure_s=0.0, temperature_c=20.0, generator=seed
        ).double()
        for seed, level in enumerate((0.0, threshold_e))
    )
    snr = float(lit.mean() - dark.mean()) / float(lit.std())
    assert snr == pytest.approx(1, abs=5 * math.sqrt(2.5 / lit.numel()))


def test_list_has_a_line_for_each_preset(capsys: Output) -> None:
    assert main(["cameras"]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 80
    rows = {
        line.split()[0]: line.split()[1:] for line in out.splitlines() if line and line.split()[0] in PRESETS
    }
    assert list(rows) == list(PRESETS)
    assert rows["imx250"] == [
        "3.45", "10715", "2.45", "0.3816", "12", "2464x2056", "10715", "40.3", "70.7",
    ]  # fmt: skip
    assert rows["lin2024"][6] == "696"
    facts = told(capsys, "cameras")
    assert [entry["camera"]["name"] for entry in facts] == list(PRESETS)
    assert facts[0]["derived"]["snr_max_db"] == pytest.approx(40.3, abs=0.005)


def test_one_camera_shows_every_figure_and_source(capsys: Output, tmp_path: Path) -> None:
    assert main(["cameras", "imx250"]) == 0
    out = capsys.readouterr().out
    words = " ".join(out.split())
    for name in PRESETS["imx250"].to_dict():
        assert name in words or name == "sources"
    for text in ("0.6 at 525 nm", "quoted: manual", "chosen: the full well is full scale", "10715"):
        assert text in words
    many = {"wavelengths_nm": list(range(400, 701)), "values": [0.5] * 301}
    path = tmp_path / "own.json"
    path.write_text(json.dumps({"base": "imx250", "quantum_efficiency": many}))
    assert main(["cameras", str(path)]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "301 samples" in words
    assert "from own.json" in words


def test_saved_edited_and_used(tmp_path: Path, capsys: Output) -> None:
    """The way of one's own camera: saved, edited, simulated with; its lens and noise are in the picture."""
    path = tmp_path / "mine.yaml"
    assert main(["cameras", "imx250", "--save", str(path)]) == 0
    assert str(path) in capsys.readouterr().out
    assert told(capsys, "cameras", path)["camera"] == PRESETS["imx250"].to_dict()
    path.write_text(path.read_text().replace("f_number: 1.4", "f_number: 2.8"))
    write_picture(tmp_path / "scene.png", np.full((8, 9), 200, np.uint8))
    command = ("simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png")
    mine = told(capsys, *command, "--camera", path)
    preset = told(capsys, *command, "--camera", "imx250")
    assert preset["white_electrons"] == pytest.approx(4 * mine["white_electrons"])
    back = told(capsys, *command, "--camera", path, "--f-number", 1.4)
    assert back["white_electrons"] == pytest.approx(preset["white_electrons"])


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_plot(tmp_path: Path, capsys: Output, suffix: str) -> None:
    path = tmp_path / f"camera.{suffix}"
    assert main(["cameras", "imx250", "--plot", str(path)]) == 0
    assert str(path) in capsys.readouterr().out
    head = path.read_bytes()[:100]
    assert {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix] in head
    if suffix == "png":
        picture = cv2.imread(str(path))
        assert picture.shape[0] > 500 < picture.shape[1]
        blue, orange = (
            np.abs(picture.astype(int) - bgr).max(axis=2) < 30 for bgr in ((178, 114, 0), (0, 94, 213))
        )
        assert min(blue.sum(), orange.sum()) > 300  # points and saturation


def test_figure_holds_what_was_measured() -> None:
    camera = PRESETS["imx250"]
    points = cameras.measured(camera)
    whole = cameras.unclipped(camera, points.photo_e)
    left, right = cameras.draw(camera).axes
    for axes, x, y in (
        (left, points.signal_dn, points.variance_dn2),
        (right, points.photo_e, points.snr),
    ):
        shown = next(line for line in axes.lines if line.get_label() == "measured")
        np.testing.assert_array_equal(shown.get_xdata(), x[whole & (x > 0)])
        np.testing.assert_array_equal(shown.get_ydata(), y[whole & (x > 0)])
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    said = " ".join(text.get_text() for axes in (left, right) for text in axes.texts)
    for text in (
        "K = 0.3816",
        "read noise 2.45",
        "saturation, 10715",
        "SNR max 40.3 dB",
        "70.7 dB",
        "SNR 1 at 3.11",
    ):
        assert text in said


def test_plot_of_a_camera_that_always_clips(tmp_path: Path) -> None:
    odd = replace(
        PRESETS["imx250"], bit_depth=1, system_gain_dn_per_e=0.1, black_level_dn=0.0, read_noise_e=0.0
    )
    cameras.write(odd, tmp_path / "odd.png")
    assert (tmp_path / "odd.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("pinhole",), "camera = 'pinhole': neither a preset nor a file; presets are ar0132at"),
        (("nowhere.yaml",), "neither a preset nor a file"),
        (("bad.yaml",), "bad.yaml: field 'read_noise' is unknown; did you mean 'read_noise_e'"),
        (("imx250", "--save", "mine.txt"), "suffix of mine.txt"),
        (("imx250", "--save", "nowhere/mine.yaml"), "nowhere/mine.yaml"),
        (("imx250", "--plot", "mine.txt", "--save", "mine.yaml"), "suffix of mine.txt"),
        (("imx250", "--plot", "nowhere/mine.png"), "nowhere/mine.png"),
        (("--save", "mine.yaml"), "need a camera"),
        (("--plot", "mine.png"), "need a camera"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text("base: imx250\nread_noise: 3\n")
    refused(capsys, named, "cameras", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.yaml"]
    if len(arguments) == 1:
        refused(capsys, named, "sweep", "--camera", *arguments, "-o", "run")


@pytest.mark.slow
def test_help_and_list_are_light() -> None:
    """The help imports nothing heavy; the list draws nothing."""
    code = (
        "import sys\nfrom blurnoise_eval.cli import main\n"
        "try: main(sys.argv[1:])\nexcept SystemExit: pass\n"
        "print(sorted({'torch', 'numpy', 'matplotlib', 'yaml', 'rich', 'onnxruntime'} & set(sys.modules)))"
    )

    def heavy(*arguments: str) -> str:
        command = [sys.executable, "-c", code, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1]

    assert heavy("cameras", "--help") == "['rich']"  # lays the help out
    assert "matplotlib" not in heavy("cameras")
