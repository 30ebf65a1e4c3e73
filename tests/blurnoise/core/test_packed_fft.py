"""OpenCV's packed spectra against NumPy's, and memory that threads share."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from blurnoise._core import packed_fft as packed
from blurnoise._core.threads import borrowed


@pytest.mark.parametrize("size", [(1, 8), (7, 12), (12, 30), (45, 64)])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_packed_product_is_the_transforms_product(size: tuple[int, int], kind: type) -> None:
    rng = np.random.default_rng(0)
    plane = rng.random(size).astype(kind)
    fy, fx = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    # Even, but not in each axis alone, and periodic, so that it joins its alias at half a cycle per pixel.
    response = 0.3 + 0.5 * np.cos(2 * np.pi * (2 * fx + 3 * fy)) + 0.2 * np.cos(2 * np.pi * fx)
    factors = np.empty(size, kind)
    packed.pack(response.astype(kind), factors)
    got = packed.multiply(plane, factors, (np.empty_like(plane), np.empty_like(plane)))
    expected = np.fft.irfft2(np.fft.rfft2(plane) * response, s=size)
    np.testing.assert_allclose(got, expected, atol=1e-6 if kind is np.float32 else 1e-13)


def test_rows_alone() -> None:
    plane = np.random.default_rng(1).random((5, 16))
    response = np.cos(np.fft.rfftfreq(16))[None]
    factors = np.empty((1, 16))
    packed.pack(response, factors)
    expected = np.fft.irfft(np.fft.rfft(plane) * response, n=16)
    for each in (factors, np.repeat(factors, 5, axis=0)):
        got = packed.multiply(plane, each, (np.empty_like(plane), np.empty_like(plane)), rows_alone=True)
        np.testing.assert_allclose(got, expected, atol=1e-14)


def test_borrowed_memory_is_ones_own() -> None:
    """Many threads write their own number and find it still there; what was used is used again."""

    def check(number: int) -> bool:
        with borrowed([(50, 40), (3,)], np.float32) as (large, small):
            large[:], small[:] = number, -number
            with borrowed([(50, 40)], np.float64) as (inner,):
                inner[:] = 0
            return bool((large == number).all() and (small == -number).all())

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(check, range(400)))
    with borrowed([(50, 40)], np.float32) as (first,):
        address = first.ctypes.data
    with borrowed([(50, 40)], np.float32) as (second,):
        assert second.ctypes.data == address
