"""``blurnoise simulate``: its picture, its numbers, and what it says of them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import write_picture
from commands import Output, main, pixels, told

from blurnoise import Camera, simulate
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.picture.develop import develop_8bit


@pytest.mark.parametrize("shape", [(31, 44), (31, 44, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("camera", ["imx250", "lin2024"])
def test_simulate(tmp_path: Path, capsys: Output, shape: tuple[int, ...], dtype: type, camera: str) -> None:
    source, picture = tmp_path / "scene.png", pixels(shape, dtype)
    write_picture(source, picture)
    options = ("--exposure-ms", 12.3, "--lux", 70, "--dx", 500, "--dy", -90, "--seed", 5, "--camera", camera)
    facts = told(capsys, "simulate", source, "-o", tmp_path / "dn.png", *options, "--bit-depth", "native")
    assert main(["simulate", str(source), "-o", str(tmp_path / "view.png"), *map(str, options)]) == 0
    assert "blur_px" in capsys.readouterr().out

    chosen = Camera.preset(camera)
    planes = picture[None] if picture.ndim == 2 else picture.transpose(2, 0, 1)
    dn = simulate(
        torch.from_numpy((planes / np.iinfo(dtype).max).astype(np.float32))[None],
        chosen,
        exposure_s=12.3 / 1e3,
        illuminance_lux=70,
        velocity_px_s=(500, -90),
        generator=[5],
    )
    native = cv2.imread(str(tmp_path / "dn.png"), cv2.IMREAD_UNCHANGED)
    view = cv2.imread(str(tmp_path / "view.png"), cv2.IMREAD_UNCHANGED)
    assert (native.dtype, native.shape) == (np.uint16, shape)
    assert (view.dtype, view.shape) == (np.uint8, shape)
    if len(shape) == 3:
        native, view = (each[..., ::-1].transpose(2, 0, 1) for each in (native, view))
    np.testing.assert_array_equal(native, dn.squeeze().numpy())
    np.testing.assert_array_equal(view, develop_8bit(dn, chosen).squeeze().numpy())
    assert facts["blur_px"] == pytest.approx(np.hypot(500, 90) * 0.0123)
    assert facts["white_electrons"] == pytest.approx(photoelectrons(chosen, 70, 0.0123))
    assert facts["mean_dn"] == pytest.approx(float(dn.mean()))
    assert (facts["camera"], facts["full_scale_dn"]) == (camera, 4095)


@pytest.mark.parametrize("shape", [(31, 44), (31, 44, 3)])
@pytest.mark.parametrize("camera", ["imx250c", "mono.yaml"])
def test_simulate_with_colour_filters_or_one_plane(
    tmp_path: Path, capsys: Output, shape: tuple[int, ...], camera: str
) -> None:
    """Natively the raw plane; to look at, colours of a mosaic and grey of one plane, in the photograph's channels."""
    (tmp_path / "mono.yaml").write_text("base: imx250\ncfa: mono\n")
    taker = Camera.preset(camera) if "." not in camera else Camera.load(tmp_path / camera)
    name = camera if "." not in camera else str(tmp_path / camera)
    source, picture = tmp_path / "scene.png", pixels(shape, np.uint8)
    write_picture(source, picture)
    options = ("--exposure-ms", 12.3, "--lux", 70, "--seed", 5, "--camera", name)
    facts = told(capsys, "simulate", source, "-o", tmp_path / "dn.png", *options, "--bit-depth", "native")
    told(capsys, "simulate", source, "-o", tmp_path / "view.png", *options)
    planes = picture[None] if picture.ndim == 2 else picture.transpose(2, 0, 1)
    scene = torch.from_numpy((planes / 255).astype(np.float32))[None]
    dn = simulate(scene, taker, exposure_s=12.3 / 1e3, illuminance_lux=70, generator=[5])
    native = cv2.imread(str(tmp_path / "dn.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(native, dn[0, 0].numpy())
    view = cv2.imread(str(tmp_path / "view.png"), cv2.IMREAD_UNCHANGED)
    seen = develop_8bit(dn, taker)[0].permute(1, 2, 0).numpy()
    assert view.shape == ((31, 44, 3) if taker.cfa == "RGGB" else shape)
    np.testing.assert_array_equal(view[..., ::-1] if view.ndim == 3 else view[..., None], np.broadcast_to(
        seen, view.shape if view.ndim == 3 else (*shape, 1)))  # fmt: skip
    assert facts["cfa"] == taker.cfa
    assert facts["white_electrons"] == pytest.approx(photoelectrons(taker, 70, 0.0123))
    if taker.cfa == "RGGB":
        assert facts["white_electrons_G"] == pytest.approx(facts["white_electrons"])
        assert facts["white_electrons_B"] < facts["white_electrons_R"] < facts["white_electrons_G"]


def test_simulate_with_another_lens(tmp_path: Path, capsys: Output) -> None:
    write_picture(tmp_path / "scene.png", pixels((8, 9)))
    command = ("simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png")
    wide, narrow = (told(capsys, *command, "--f-number", number)["white_electrons"] for number in (2, 4))
    assert wide == pytest.approx(4 * narrow)


@pytest.mark.parametrize("anchor", [None, "mean", "p50", "1,2,9,8"])
def test_simulate_says_what_light_on_a_photograph_means(
    tmp_path: Path, capsys: Output, anchor: str | None
) -> None:
    """Two photographs of one scene, 2 EV apart: with an anchor the same frame, without a quarter of it."""
    light = 0.05 + 0.9 * np.random.default_rng(3).random((20, 30)) ** 2
    command: tuple[object, ...] = ("--lux", 20, "--camera", "imx250")
    command += () if anchor is None else ("--grey-anchor", anchor)
    facts = []
    for stops in (0, 2):
        coded = srgb_from_linear(torch.from_numpy(light / 2**stops)).mul(65535).round().numpy()
        write_picture(tmp_path / "scene.png", coded.astype(np.uint16))
        facts.append(told(capsys, "simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png", *command))
    black = Camera.preset("imx250").black_level_dn
    ratio = (facts[0]["mean_dn"] - black) / (facts[1]["mean_dn"] - black)
    assert ratio == pytest.approx(1 if anchor else 4, rel=0.01)
    assert ("18 % reflectance is" in facts[0]["reflectance"]) == bool(anchor)
    assert ("above_white_percent" in facts[0]) == bool(anchor)
    explained = ["simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png", "--explain", *command]
    assert main(list(map(str, explained))) == 0
    assert ("brightness is taken for reflectance" in capsys.readouterr().out) == (anchor is None)
    assert main([*map(str, explained), "--grey-anchor", "grey"]) == 2
    assert "--grey-anchor = 'grey': must be mean, pNN" in capsys.readouterr().err


def test_simulate_explains_what_it_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "grey.png"
    write_picture(picture, np.full((40, 50), 128, np.uint8))
    command = ["simulate", str(picture), "-o", str(tmp_path / "out.png"), "--dx", "900", "--explain"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    for words in ("motion", "9 px", "shot noise", "read noise", "left out"):
        assert words in shown
    assert main([*command, "--json"]) == 0
    stages = {stage["name"]: stage for stage in json.loads(capsys.readouterr().out)["stages"]}
    assert stages["motion"]["kept"]
    assert not stages["PRNU"]["kept"]
    assert main([*command, "--tolerance-dn", "0"]) == 2
    assert "tolerance_dn = 0.0" in capsys.readouterr().err


def test_the_picture_itself_is_not_written_over(tmp_path: Path, capsys: Output) -> None:
    source = tmp_path / "scene.png"
    write_picture(source, pixels((31, 44), np.uint8))
    before = source.read_bytes()
    assert main(["simulate", str(source), "-o", str(source)]) == 2
    assert "is the picture itself; must be another file" in capsys.readouterr().err
    assert source.read_bytes() == before
