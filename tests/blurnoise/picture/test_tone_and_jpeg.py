"""Tone curves and JPEG: closed forms and limits, of cameras with and without a mosaic."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from blurnoise import Camera, develop
from blurnoise.optics import colour
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.picture.develop import develop_8bit, in_channels, tabulated

IMX250 = Camera.preset("imx250")
IMX250C = Camera.preset("imx250c")


def numbers(channels: int = 3, side: int = 24) -> torch.Tensor:
    """Digital numbers of something smooth, and noise."""
    y, x = torch.meshgrid(torch.arange(side), torch.arange(side + 3), indexing="ij")
    wave = 1800 + 1500 * torch.sin(x / 5.0) * torch.cos(y / 7.0)
    noise = 40 * torch.randn(2, channels, side, side + 3, generator=torch.Generator().manual_seed(1))
    return (wave + noise).round().clamp(0, 4095)


def test_filmic_is_an_s_curve_of_srgb() -> None:
    light = torch.linspace(-0.2, 1.4, 50)
    coded = colour.toned(light, "filmic")
    value = srgb_from_linear(light)
    torch.testing.assert_close(coded, 3 * value**2 - 2 * value**3)
    assert float(coded[0]) == 0
    assert float(coded[-1]) == 1
    assert float(colour.toned(torch.tensor(0.2140411), "filmic")) == pytest.approx(0.5, abs=1e-6)  # sRGB 0.5


def test_points_are_joined_by_straight_lines() -> None:
    points = ((0.0, 0.1), (0.25, 0.5), (0.5, 0.5), (1.0, 0.9))
    light = torch.linspace(-0.5, 1.5, 81, dtype=torch.float64).requires_grad_()
    coded = colour.toned(light, points)
    at, values = np.array(points).T
    assert coded.detach().numpy() == pytest.approx(np.interp(light.detach().clamp(0, 1).numpy(), at, values))
    coded.sum().backward()
    assert light.grad is not None
    assert light.grad[[10, 29, 31]].tolist() == pytest.approx([0, 1.6, 0])  # at -0.25, below and above 0.25
    linear = colour.toned(light.detach(), ((0, 0), (1, 1)))
    torch.testing.assert_close(linear, light.detach().clamp(0, 1))


@pytest.mark.parametrize("curve", ["filmic", ((0.0, 0.0), (0.3, 0.7), (1.0, 1.0))])
def test_cameras_develop_by_their_curve(curve: Any) -> None:
    taker = replace(IMX250, tone=curve)
    assert tabulated(taker)
    linear = develop(numbers(), taker, encoding="linear")
    assert torch.equal(linear, develop(numbers(), IMX250, encoding="linear"))
    torch.testing.assert_close(develop(numbers(), taker), colour.toned(linear, curve), rtol=0, atol=1e-6)
    assert not torch.equal(develop(numbers(), taker), develop(numbers(), IMX250))


@pytest.mark.parametrize(("taker", "channels"), [(IMX250, 3), (IMX250, 1), (IMX250, 4), (IMX250C, 1)])
def test_jpeg_is_opencvs_round_trip(taker: Camera, channels: int) -> None:
    """Of the 8-bit picture, each by itself; better quality, smaller error; in 8 bits as in floats."""
    dn = numbers(channels)
    clean = develop_8bit(dn, taker)
    errors = []
    for quality in (20, 60, 95):
        filed = replace(taker, jpeg_quality=quality)
        assert not tabulated(filed)
        seen = develop_8bit(dn, filed)
        assert seen.shape == clean.shape
        assert torch.equal((develop(dn, filed) * 255).round().byte(), seen)
        assert torch.equal(develop_8bit(dn[1:], filed)[0], seen[1])
        errors.append(float((seen.float() - clean.float()).square().mean()))
        if clean.shape[1] == 3:
            given = np.ascontiguousarray(clean[0].permute(1, 2, 0).numpy()[..., ::-1])
            _, file = cv2.imencode(".jpg", given, [cv2.IMWRITE_JPEG_QUALITY, quality])
            back = cv2.imdecode(file, cv2.IMREAD_COLOR)[..., ::-1]  # type: ignore[index]
            assert np.array_equal(seen[0].permute(1, 2, 0).numpy(), back)
    assert errors[0] > errors[1] > errors[2] > 0
    linear = develop(dn, replace(taker, jpeg_quality=20), encoding="linear")
    assert torch.equal(linear, develop(dn, taker, encoding="linear"))


def test_jpegs_derivatives_are_those_of_none() -> None:
    filed, dn = replace(IMX250, jpeg_quality=50), numbers().double().requires_grad_()
    seen = develop(dn, filed)
    seen.sum().backward()
    plain = numbers().double().requires_grad_()
    develop(plain, IMX250).sum().backward()
    assert torch.equal(dn.grad, plain.grad)  # type: ignore[arg-type]
    torch.testing.assert_close(seen.detach(), develop(numbers().double(), filed), rtol=0, atol=1e-12)


def test_pictures_in_the_channels_of_others() -> None:
    colours = torch.tensor([200, 100, 50], dtype=torch.uint8).view(1, 3, 1, 1)
    assert in_channels(colours, 3) is colours
    assert in_channels(colours, 1).flatten().tolist() == [round(0.2126 * 200 + 0.7152 * 100 + 0.0722 * 50)]
    assert in_channels(colours[:, :1], 3).flatten().tolist() == [200, 200, 200]
