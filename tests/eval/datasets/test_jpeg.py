"""How JPEG files were encoded, told from files of two encoders."""

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets.jpeg import Encoding, encoding
from PIL import Image

PICTURE = np.random.default_rng(1).integers(0, 256, (40, 56, 3), np.uint8)


@pytest.mark.parametrize("quality", [5, 30, 50, 75, 96, 100])
def test_quality_is_that_of_the_encoder(tmp_path, quality):
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg", quality=quality)
    cv2.imwrite(str(tmp_path / "b.jpg"), PICTURE, [cv2.IMWRITE_JPEG_QUALITY, quality])
    for name in ("a.jpg", "b.jpg"):
        assert encoding(tmp_path / name).quality == pytest.approx(quality, abs=1)


@pytest.mark.parametrize(("place", "name"), list(enumerate(["4:4:4", "4:2:2", "4:2:0"])))
def test_subsampling_is_that_of_the_encoder(tmp_path, place, name):
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg", quality=90, subsampling=place)
    assert encoding(tmp_path / "a.jpg") == Encoding(90, name)


def test_other_files_have_none(tmp_path):
    Image.fromarray(PICTURE[..., 0]).save(tmp_path / "grey.jpg", quality=90)
    assert encoding(tmp_path / "grey.jpg") == Encoding(90, None)
    Image.fromarray(PICTURE).save(tmp_path / "a.png")
    (tmp_path / "b.jpg").write_bytes(b"\xff\xd8\xff")
    assert (
        encoding(tmp_path / "a.png") is encoding(tmp_path / "b.jpg") is encoding(tmp_path / "no.jpg") is None
    )
