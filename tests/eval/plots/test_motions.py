"""The gallery of motions: each tile is what simulate makes of that motion, and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.plots import gallery, motions
from commands import main
from numpy.typing import NDArray

from blurnoise import Camera

SIZE = (54, 80)
Floats = NDArray[np.float32]


def stripes(shape: tuple[int, ...] = (*SIZE, 3), side_px: int = 6) -> Floats:
    """Blocks of 6 px in both directions, whose contrast any motion of 18 px takes away."""
    y, x = np.mgrid[: shape[0], : shape[1]] // side_px
    checks = 0.15 + 0.2 * ((x + y) % 2)
    return np.broadcast_to(checks[..., None] if len(shape) == 3 else checks, shape).astype(np.float32)


@pytest.fixture(scope="module")
def made() -> dict[str, gallery.Tile]:
    matte = motions.middle_box(SIZE)
    shown = motions.tiles(
        stripes(), matte, Camera.preset("imx250"), exposure_s=0.02, illuminance_lux=100.0, speed_px_s=900.0
    )
    return {kind.name: tile for kind, tile in zip(motions.KINDS, shown, strict=True)}


def contrast(tile: gallery.Tile, rows: slice, columns: slice) -> float:
    return float(tile.picture[rows, columns].std())


MIDDLE, CORNER = (slice(22, 34), slice(32, 50)), (slice(2, 14), slice(12, 68))


@pytest.mark.parametrize(
    ("start", "middle_is_sharp", "corner_is_sharp"),
    [("all moves", False, False), ("targets move", False, True), ("the camera follows", True, False)],
)
def test_what_moves_is_blurred_and_the_rest_is_sharp(
    made: dict[str, gallery.Tile], start: str, middle_is_sharp: bool, corner_is_sharp: bool
) -> None:
    (tile,) = (each for name, each in made.items() if name.startswith(start))
    at_rest = 255 * 0.07  # of blocks of .15 and .35, coded
    assert (contrast(tile, *MIDDLE) > at_rest) is middle_is_sharp
    assert (contrast(tile, *CORNER) > at_rest) is corner_is_sharp
    assert tile.motion.endswith(": 18 px")


def test_every_kind_is_another_picture(made: dict[str, gallery.Tile]) -> None:
    pictures = [tile.picture.astype(int) for tile in made.values()]
    for place, one in enumerate(pictures):
        for other in pictures[place + 1 :]:
            assert np.abs(one - other).mean() > 1.0


def test_a_road_is_sharp_at_the_horizon_and_not_before_the_car() -> None:
    """y² V T / h f: 5.6 px down in the last row of 160, against blocks of 2 px; nothing in the sky."""
    size = (160, 240)
    imx250 = Camera.preset("imx250")
    tile = motions.tiles(
        stripes(size, 2),
        motions.middle_box(size),
        imx250,
        exposure_s=0.02,
        illuminance_lux=100.0,
        speed_px_s=0.0,
    )[-1]
    assert contrast(tile, slice(4, 76), slice(90, 150)) > 3 * contrast(tile, slice(150, 160), slice(90, 150))


def test_rolling_shutters_shear_and_stretch(made: dict[str, gallery.Tile]) -> None:
    """Cameras are those of the tiles; the sheared picture is not the blurred one, nor the stretched one."""
    rolling = {tile.camera.shutter for name, tile in made.items() if name.startswith("rolling")}
    assert rolling == {"rolling"}
    assert {tile.camera.shutter for name, tile in made.items() if not name.startswith("rolling")} == {
        "global"
    }


def test_command_shows_motions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, mask = tmp_path / "photo.png", tmp_path / "mask.png"
    write_picture(source, (stripes(SIZE) * 65535).astype(np.uint16))
    cover = np.zeros(SIZE, np.uint8)
    cover[20:40, 30:50] = 255
    write_picture(mask, cover)
    command: list[Any] = ["gallery", source, "-o", tmp_path / "motion.png", "--motion", "--exposure-ms", 20]
    command += ["--object", mask, "--size", 60, "--json"]
    assert main([str(each) for each in command]) == 0
    told = json.loads(capsys.readouterr().out)["tiles"]
    assert [tile["motion"].startswith(kind.name) for tile, kind in zip(told, motions.KINDS, strict=True)] == [
        True
    ] * len(motions.KINDS)
    assert {tile["exposure_s"] for tile in told} == {0.02}
    assert cv2.imread(str(tmp_path / "motion.png")) is not None
    for wrong, named in ((["--object", "1,2,3,4"], "object"), (["--motion", "--object", "1,2"], "object")):
        assert main(["gallery", str(source), "-o", str(tmp_path / "no.png"), *wrong]) == 2
        error = capsys.readouterr().err
        assert named in error
        assert error.count("\n") == 1
    assert not (tmp_path / "no.png").exists()
