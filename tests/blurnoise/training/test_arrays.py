"""NumPy pictures: one function, beside that for tensors."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from blurnoise import Camera, Exposure, expose_numpy, expose_pictures

EXPOSURE = Exposure(Camera.preset("imx250c"), 0.01, 100.0, seed=1)


@pytest.fixture
def picture():
    return np.random.default_rng(1).integers(0, 256, (45, 63, 3)).astype(np.uint8)


@pytest.mark.parametrize("kind", ["uint8", "float32", "float64"])
def test_an_array_gets_what_a_tensor_gets(picture, kind):
    given = picture if kind == "uint8" else (picture / 255).astype(kind)
    both = [EXPOSURE, replace(EXPOSURE, seed=2)]
    seen = expose_numpy(np.stack([given, given]), both)
    tensor = torch.from_numpy(np.stack([given, given])).permute(0, 3, 1, 2)
    tensor = tensor / 255.0 if kind == "uint8" else tensor
    wanted = expose_pictures(tensor, both).permute(0, 2, 3, 1).numpy()
    assert seen.dtype == given.dtype
    assert np.abs(seen / (255 if kind == "uint8" else 1) - wanted).max() <= (0.5 / 255 + 1e-6)
    alone = expose_numpy(given, both[1])
    assert np.array_equal(alone, seen[1])


def test_one_exposure_serves_all_pictures_each_with_noise_of_its_own(picture):
    seen = expose_numpy(np.stack([picture, picture]), EXPOSURE)
    assert np.array_equal(seen[0], expose_numpy(picture, EXPOSURE))
    assert not np.array_equal(seen[1], seen[0])


def test_the_order_of_channels_is_stated(picture):
    rgb = expose_numpy(picture, EXPOSURE)
    bgr = expose_numpy(picture[..., ::-1], EXPOSURE, channels="bgr")
    assert np.array_equal(bgr[..., ::-1], rgb)
    assert expose_numpy(picture[..., 0], EXPOSURE).shape == (45, 63)


@pytest.mark.parametrize(
    ("image", "words"),
    [(np.zeros((4, 5, 3), np.int32), "int32"), (np.zeros((4, 5, 2), np.uint8), "2 channels")],
)
def test_other_arrays_are_refused(image, words):
    with pytest.raises((TypeError, ValueError), match=words):
        expose_numpy(image, EXPOSURE)


@pytest.mark.slow
def test_a_torchvision_of_another_build_is_named(tmp_path):
    """torchvision's wheel for CUDA beside torch's for the CPU."""
    (tmp_path / "torchvision.py").write_text('raise RuntimeError("operator torchvision::nms does not exist")')
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", "import blurnoise.training.torchvision"],
        env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "ImportError: torchvision and torch are different builds" in done.stderr
