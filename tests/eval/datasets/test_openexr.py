"""Linear light from OpenEXR files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import UnreadablePicture, decode_linear

OpenEXR = pytest.importorskip("OpenEXR")
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
LIGHT = np.random.default_rng(3).uniform(0, 60, (7, 11, 3)).astype(np.float32)


def _write(path: Path, channels: dict[str, np.ndarray]) -> Path:
    OpenEXR.File(HEADER, channels).write(str(path))
    return path


def test_colours_come_back_in_their_order(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.exr", {"RGB": LIGHT, "Z": np.zeros((7, 11), np.float32)})
    np.testing.assert_array_equal(decode_linear(path), LIGHT)


def test_light_alone_in_half_precision(tmp_path: Path) -> None:
    half = LIGHT[..., 0].astype(np.float16)
    path = _write(tmp_path / "a.exr", {"Y": half})
    np.testing.assert_array_equal(decode_linear(path), half.astype(np.float32))


@pytest.mark.parametrize(
    ("channels", "megapixels", "said"),
    [
        ({"Z": LIGHT[..., 0]}, 1.0, "must have R, G, B or Y"),
        ({"RGB": LIGHT}, 1e-5, "11 x 7 px"),
        ({"Y": -LIGHT[..., 0]}, 1.0, "negative or not finite"),
    ],
)
def test_what_cannot_be_used_is_said_in_a_line(
    tmp_path: Path, channels: dict[str, np.ndarray], megapixels: float, said: str
) -> None:
    path = _write(tmp_path / "a.exr", channels)
    with pytest.raises(UnreadablePicture, match=said):
        decode_linear(path, megapixels)


def test_a_broken_file(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.exr", {"RGB": LIGHT})
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(UnreadablePicture, match=r"a\.exr"):
        decode_linear(path)
