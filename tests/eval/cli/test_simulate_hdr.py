"""``blurnoise simulate`` with captures, lamps and light brighter than white, against the library."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import decode_linear, write_picture
from commands import main

from blurnoise import Camera, ExposedScene, photoelectrons
from blurnoise.light.flicker import Pwm
from blurnoise.optics.camera import staggered
from blurnoise.scene.hdr import captured, developed, fuse

Output = pytest.CaptureFixture[str]
IMX250 = Camera.preset("imx250")
LIGHT = (8 * np.random.default_rng(5).random((12, 17, 3)) ** 4).astype(np.float32)
TAKEN = ("--exposure-ms", "10", "--lux", "80", "--dx", "500", "--seed", "5")
GIVEN: dict[str, Any] = {
    "exposure_s": 0.01,
    "illuminance_lux": 80.0,
    "velocity_px_s": (500.0, 0.0),
    "generator": [5],
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With linear light of floats, the same as sRGB's 16 bits where that holds it, and a mask."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "light.tiff").write_bytes(cv2.imencode(".tiff", LIGHT[..., ::-1])[1].tobytes())
    write_picture(tmp_path / "grey.png", np.full((12, 17), 65535, np.uint16))
    mask = np.zeros((12, 17), np.uint8)
    mask[3:6, 4:9] = 255
    write_picture(tmp_path / "mask.png", mask)
    write_picture(tmp_path / "small.png", mask[:5])
    return tmp_path


def told(capsys: Output, *command: str) -> dict[str, Any]:
    """What the command says."""
    assert main(["simulate", *command, "-o", "out.png", "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_captures_of_light_brighter_than_white(folder: Path, capsys: Output) -> None:
    hdr = ("light.tiff", "--picture-tone", "linear", "--camera", "imx250", "--hdr", "16,64", *TAKEN)
    light = torch.from_numpy(LIGHT).permute(2, 0, 1)[None].contiguous()
    frames = captured(ExposedScene(light), IMX250, staggered(16, 64), **GIVEN)
    facts = told(capsys, *hdr, "--bit-depth", "native")
    for name, frame in zip(("out.png", "out_2.png", "out_3.png"), frames, strict=True):
        stored = cv2.imread(name, cv2.IMREAD_UNCHANGED)[..., ::-1].transpose(2, 0, 1)
        np.testing.assert_array_equal(stored, frame[0].numpy())
    told(capsys, *hdr, "--hdr-white", "8")
    electrons = fuse(frames, IMX250, staggered(16, 64))
    seen = developed(electrons, IMX250, white_e=8 * photoelectrons(IMX250, 80.0, 0.01))
    stored = cv2.imread("out.png", cv2.IMREAD_UNCHANGED)[..., ::-1].transpose(2, 0, 1)
    np.testing.assert_array_equal(stored, (255 * seen[0]).round().numpy())
    assert facts["captures"] == 3
    assert facts["fused_saturation_electrons"] == pytest.approx(64 * 10715)
    assert facts["above_white_percent"] == pytest.approx(100 * float((LIGHT.max(-1) > 1).mean()))


def test_a_camera_of_several_captures(folder: Path, capsys: Output) -> None:
    (folder / "hdr.yaml").write_text("base: imx250\ncaptures: [{}, {exposure_ratio: 16}]\n")
    linear = ("light.tiff", "--picture-tone", "linear", *TAKEN)
    stated = told(capsys, *linear, "--camera", "hdr.yaml")
    by_file = cv2.imread("out.png")
    asked = told(capsys, *linear, "--camera", "imx250", "--hdr", "16")
    np.testing.assert_array_equal(by_file, cv2.imread("out.png"))
    assert {**stated, "camera": "imx250"} == asked
    (folder / "hdr.yaml").write_text("base: imx250\ncaptures: [{gain_db: 12.0}, {start_s: 0.0}]\n")
    dual = told(capsys, *linear, "--camera", "hdr.yaml")
    assert dual["fused_saturation_electrons"] == pytest.approx(10715)
    assert dual["saturation_electrons"] == pytest.approx(10715 / 10**0.6)


def test_a_lamp_of_pulses_where_the_mask_says(folder: Path, capsys: Output) -> None:
    command = (
        "grey.png",
        "--pwm-mask",
        "mask.png",
        "--exposure-ms",
        "1",
        "--lux",
        "20",
        "--bit-depth",
        "native",
    )
    facts = told(capsys, *command, "--pwm", "90,0.1,0.5")
    dn = cv2.imread("out.png", cv2.IMREAD_UNCHANGED)
    assert facts["pwm_dark_percent"] == pytest.approx(81)
    assert dn[3:6, 4:9].mean() < dn[:3].mean() - 10
    drawn = told(capsys, *command, "--pwm", "90,0.1", "--seed", "5")
    assert drawn["pwm_phase"] == Pwm(90.0, 0.1).with_phase_of(5).phase
    steady = told(capsys, *command[:1], *TAKEN)
    assert told(capsys, *command[:1], *TAKEN, "--pwm", "90,1")["mean_dn"] == steady["mean_dn"]


def test_emitters_are_so_many_times_brighter(folder: Path, capsys: Output) -> None:
    taken = ("grey.png", "--exposure-ms", "1", "--lux", "20", "--bit-depth", "native")
    told(capsys, *taken)
    plain = cv2.imread("out.png", cv2.IMREAD_UNCHANGED).astype(float) - IMX250.black_level_dn
    facts = told(capsys, *taken, "--emitters", "mask.png:9")
    seen = cv2.imread("out.png", cv2.IMREAD_UNCHANGED).astype(float) - IMX250.black_level_dn
    assert seen[3:6, 4:9].mean() / plain.mean() == pytest.approx(9, rel=0.05)
    assert seen[8:].mean() / plain[8:].mean() == pytest.approx(1, rel=0.05)
    assert facts["above_white_percent"] == pytest.approx(100 * 15 / (12 * 17))


def test_linear_light_of_files(folder: Path) -> None:
    np.testing.assert_array_equal(decode_linear(folder / "light.tiff"), LIGHT)
    (folder / "light.hdr").write_bytes(cv2.imencode(".hdr", LIGHT[..., ::-1])[1].tobytes())
    np.testing.assert_allclose(
        decode_linear(folder / "light.hdr"), LIGHT, atol=8 / 128
    )  # one exponent, 8 bits
    assert decode_linear(folder / "grey.png").max() == 1.0
