"""The gallery: its draws, its order, tiles pixel for pixel, and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.grid.values import bounds
from blurnoise_eval.plots import gallery
from blurnoise_eval.system.files import write_figure
from commands import main

from blurnoise import photoelectrons
from blurnoise.training.ranges import ExposureRanges

TWO = ExposureRanges(("imx250", "ar0237"))
Output = pytest.CaptureFixture[str]


def scene(*shape: int) -> Any:
    return np.random.default_rng(3).random(shape or (30, 44, 3), np.float32)


def photograph(folder: Path, *shape: int) -> Path:
    path = folder / "photo.png"
    write_picture(path, (scene(*shape) * 255).astype(np.uint8))
    return path


def test_tiles_lie_within_their_ranges_brightest_first() -> None:
    tiles = gallery.tiles(scene(), TWO, 24, seed=1)
    filled = [tile.white_electrons / tile.camera.saturation_e for tile in tiles]
    assert filled == sorted(filled, reverse=True)
    assert {tile.camera.name for tile in tiles} == {"imx250", "ar0237"}
    for tile in tiles:
        assert 0.001 <= tile.exposure_s <= 0.060
        assert 5 <= tile.illuminance_lux <= 500
        assert 0 <= tile.speed_px_s <= 1000
        expected = photoelectrons(tile.camera, tile.illuminance_lux, tile.exposure_s)
        assert tile.white_electrons == pytest.approx(expected)
        assert tile.blur_px == pytest.approx(tile.speed_px_s * tile.exposure_s)


def test_pictures_stay_with_their_conditions() -> None:
    """Unclipped white is as bright as its electrons say, whatever the order; five per cent off is not."""
    dim = ExposureRanges(("imx250", "ar0237"), exposure_s=(0.002, 0.008), illuminance_lux=(20.0, 80.0))
    tiles = gallery.tiles(np.ones((60, 60), np.float32), dim, 12, seed=0)
    for tile in tiles:
        camera = tile.camera
        light = tile.white_electrons * camera.system_gain_dn_per_e
        light /= camera.full_scale_dn - camera.black_level_dn
        coded = 1.055 * light ** (1 / 2.4) - 0.055
        assert tile.picture.shape == (60, 60)
        if light < 0.8:
            assert tile.picture.mean() / 255 == pytest.approx(coded, rel=0.02)
    assert sum(tile.picture.mean() < 200 for tile in tiles) > 4


def test_motion_and_its_direction_are_seen() -> None:
    """Columns of 2 px vanish under 40 px of motion across them, not along them."""
    columns = np.tile(np.array([0.2, 0.2, 0.8, 0.8], np.float32), (64, 16))
    light = {"exposure_s": 0.02, "illuminance_lux": 60.0, "speed_px_s": 2000.0}
    (across,), (along,) = (
        gallery.tiles(columns, ExposureRanges(**light, direction_deg=angle), 1, seed=0)
        for angle in (0.0, 90.0)
    )
    assert across.picture[:, 8:-8].std() < 10 < 50 < along.picture.std()


def test_seeds_repeat_tiles() -> None:
    first, again, other = (gallery.tiles(scene(), TWO, 3, seed) for seed in (5, 5, 6))
    assert all(np.array_equal(a.picture, b.picture) for a, b in zip(first, again, strict=True))
    assert [a.exposure_s for a in first] == [b.exposure_s for b in again]
    assert not {a.exposure_s for a in first} & {b.exposure_s for b in other}


@pytest.mark.parametrize("shape", [(30, 44, 3), (61, 37)])
def test_every_pixel_of_a_tile_is_drawn(tmp_path: Path, shape: tuple[int, ...]) -> None:
    coded = scene(*shape)
    tiles = gallery.tiles(coded, TWO, 4, seed=0)
    path = tmp_path / "gallery.png"
    write_figure(path, gallery.draw(coded, tiles), dpi=gallery.DPI)
    drawn = cv2.imread(str(path), cv2.IMREAD_COLOR)
    for picture in (np.asarray((coded * 255).round(), np.uint8), *(tile.picture for tile in tiles)):
        bgr = picture[..., ::-1] if picture.ndim == 3 else np.stack([picture] * 3, -1)
        found = cv2.matchTemplate(drawn, np.ascontiguousarray(bgr), cv2.TM_SQDIFF)
        # float32 sums of squares round to some units; one grey level off in every pixel would be thousands
        assert found.min() < 0.1 * bgr.size


def test_large_pictures_are_shrunk_and_small_ones_kept() -> None:
    eight = np.full((100, 300, 3), 128, np.uint8)
    assert gallery.scene(eight, 150).shape == (50, 150, 3)
    assert gallery.scene(eight, 600).shape == (100, 300, 3)
    assert gallery.scene(eight, 150).mean() == pytest.approx(128 / 255, abs=1e-5)
    assert gallery.scene(np.full((4, 5), 65535, np.uint16), 16).max() == 1.0


def test_captions_and_ranges_as_text() -> None:
    tile = gallery.Tile(np.zeros((2, 2), np.uint8), TWO.cameras[0], 0.012, 50.0, 400.0, 90.0)
    white = f"white {photoelectrons(tile.camera, 50.0, 0.012):.0f} e⁻"
    assert tile.caption == f"12 ms · 50 lux · imx250\n400 px/s · blur 4.8 px · {white}"
    assert (bounds("1:60"), bounds("2.5")) == ((1.0, 60.0), (2.5, 2.5))
    for text in ("", "1:2:3", "a:b", "1:"):
        with pytest.raises(Exception, match="low:high"):
            bounds(text)


def test_command_writes_the_gallery(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "gallery.png"
    arguments = [
        "gallery", str(photograph(tmp_path)), "-o", str(path), "--exposure-ms", "3:7", "--lux", "40",
        "--speed", "10:20", "--camera", "imx250,ar0237", "--count", "6", "--seed", "2", "--json",
    ]  # fmt: skip
    assert main(arguments) == 0
    assert cv2.imread(str(path)) is not None
    said = json.loads(capsys.readouterr().out)
    assert len(said["tiles"]) == 6
    for tile in said["tiles"]:
        assert 0.003 <= tile["exposure_s"] <= 0.007
        assert tile["illuminance_lux"] == 40
        assert 10 <= tile["speed_px_s"] <= 20
        assert tile["camera"] in ("imx250", "ar0237")


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["--exposure-ms", "0:60"], "--exposure-ms"),
        (["--lux", "9:3"], "--lux = 9:3"),
        (["--count", "1000"], "count"),
        (["--seed", "-1"], "seed"),
        (["--size", "3"], "size"),
        (["--camera", "imx250,nikon"], "nikon"),
        (["-o", "gallery.bmp"], "suffix"),
    ],
)
def test_command_names_what_is_wrong(tmp_path: Path, capsys: Output, given: list[str], named: str) -> None:
    arguments = ["gallery", str(photograph(tmp_path, 8, 9)), "-o", str(tmp_path / "gallery.png"), *given]
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert named in err
    assert not (tmp_path / "gallery.png").exists()
