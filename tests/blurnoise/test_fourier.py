"""Packed spectra of OpenCV's against NumPy's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from blurnoise.blur.fourier import Straight, pack


@pytest.mark.parametrize("size", [(1, 8), (7, 12), (12, 30), (45, 64)])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_packed_product_is_the_transforms_product(size: tuple[int, int], kind: type) -> None:
    plane = np.random.default_rng(0).random(size).astype(kind)
    fy, fx = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    # Even, but not in each axis alone, and periodic, so that it joins its alias at half a cycle per pixel.
    response = 0.3 + 0.5 * np.cos(2 * np.pi * (2 * fx + 3 * fy)) + 0.2 * np.cos(2 * np.pi * fx)
    spectrum = cv2.dft(plane)
    Straight.multiply(spectrum, pack(response.astype(kind)), spectrum)
    expected = np.fft.irfft2(np.fft.rfft2(plane) * response, s=size)
    got = cv2.dft(spectrum, flags=cv2.DFT_INVERSE)
    np.testing.assert_allclose(got, expected, atol=1e-6 if kind is np.float32 else 1e-13)
