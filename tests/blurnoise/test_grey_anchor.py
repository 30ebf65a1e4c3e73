"""The grey anchor: one scene, however it was photographed, is one scene under the camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.grid.conditions import reflectance_text

from blurnoise import Camera, ExposedScene, simulate
from blurnoise.optics.colour import linear_from_srgb, srgb_from_linear
from blurnoise.scene.metering import GreyAnchor, anchored

CAMERA = Camera.preset("imx250")
ANCHORS = ["mean", "p50", "p99.5", "12,5,40,30"]
CONDITIONS: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0}


def scene() -> torch.Tensor:
    """Linear light, (1, 3, 41, 67), colours unlike each other."""
    light = torch.rand(1, 3, 41, 67, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return light * torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64)[:, None, None]


def photograph(stops_darker: int) -> torch.Tensor:
    """The scene as an 8-bit sRGB picture of an exposure that is so many stops shorter."""
    return (srgb_from_linear(scene() / 2**stops_darker) * 255).round() / 255


def mean_frame(image: torch.Tensor, **options: Any) -> torch.Tensor:
    return simulate(
        image, CAMERA, **{"noise": False, "quantised": False, "fidelity": "full", **CONDITIONS, **options}
    )


@pytest.mark.parametrize("anchor", ANCHORS)
@pytest.mark.parametrize("stops", [1, 2])
def test_a_scene_photographed_darker_gives_the_same_frame(anchor: str, stops: int) -> None:
    """Up to what 8 bits leave of it: half a code is 1/510 of the coded range, times at most 2.4, the slope of sRGB's
    decoding at white, in light; of the darker picture 2^stops of that; times the anchor's own scale.
    """
    bright, dark = (mean_frame(photograph(each), grey_anchor=anchor) for each in (0, stops))
    scale = GreyAnchor.parse(anchor).scale(scene()[0])
    white_dn = float(mean_frame(torch.ones(1, 3, 4, 4)).mean()) - CAMERA.black_level_dn
    rounding_dn = 2.4 / 510 * (1 + 2**stops) * scale * white_dn
    assert float((bright - dark).abs().max()) < rounding_dn
    level = float(bright.mean()) - CAMERA.black_level_dn
    assert float(dark.mean()) - CAMERA.black_level_dn == pytest.approx(level, rel=0.01)
    unanchored = [float(mean_frame(photograph(each)).mean()) - CAMERA.black_level_dn for each in (0, stops)]
    assert unanchored[0] / unanchored[1] == pytest.approx(2**stops, rel=0.02)


def test_what_is_anchored_is_18_percent() -> None:
    light = scene()
    luminance = (light[0] * torch.tensor([0.2126, 0.7152, 0.0722], dtype=torch.float64)[:, None, None]).sum(0)
    for anchor, grey in (
        ("mean", luminance.mean()),
        ("p90", luminance.flatten().sort().values[round(0.9 * (luminance.numel() - 1))]),
        ("12,5,40,30", luminance[5:30, 12:40].mean()),
    ):
        found = anchored(light, anchor)
        torch.testing.assert_close(found, light * 0.18 / grey, rtol=1e-3, atol=0)
    grey_only = anchored(light[:, :1], "mean")
    assert float(grey_only.mean()) == pytest.approx(0.18)


def test_each_picture_is_anchored_by_itself() -> None:
    pair = torch.cat([scene(), scene() / 8])
    both = anchored(pair, "mean")
    torch.testing.assert_close(both[0], both[1])
    given = {"grey_anchor": "mean", "encoding": "linear", "fidelity": "auto", "generator": [3, 3]}
    together = simulate(pair, CAMERA, **CONDITIONS, **given)  # type: ignore[arg-type]
    alone = simulate(pair[1:], CAMERA, **CONDITIONS, **(given | {"generator": [3]}))  # type: ignore[arg-type]
    assert torch.equal(together[1:], alone)


def test_more_than_white_stays_and_is_told() -> None:
    """A lamp of 20 times white is 20 times as many electrons, not white's; and auto leaves out nothing of it."""
    light = torch.full((1, 1, 40, 60), 0.05, dtype=torch.float64)
    light[..., 10:20, 20:40] = 1.0
    found = anchored(light, "0,0,10,40")
    assert float(found.max()) == pytest.approx(3.6)
    given = {"exposure_s": 1e-4, "illuminance_lux": 60.0, "encoding": "linear", "grey_anchor": "0,0,10,40"}
    frame = mean_frame(light, **given) - CAMERA.black_level_dn
    white = mean_frame(torch.ones(1, 1, 4, 4), **(given | {"grey_anchor": None})) - CAMERA.black_level_dn
    assert float(frame[..., 15, 30].mean() / white.mean()) == pytest.approx(3.6, rel=1e-6)
    moved = given | {"velocity_px_s": (900.0, 0.0)}  # too little for white, not for the lamp
    auto, full = (mean_frame(light, **moved, fidelity=fidelity) for fidelity in ("auto", "full"))
    assert float((auto - full).square().mean().sqrt()) <= 0.1


def test_a_picture_of_codes_is_anchored_as_light_is() -> None:
    coded = (photograph(2)[0].permute(1, 2, 0) * 255).round().byte().numpy()
    scene_ = ExposedScene.of_picture(coded, "p50")
    expected = anchored(linear_from_srgb(photograph(2).float()), "p50")
    torch.testing.assert_close(scene_.light, expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("text", ["mean", "p5", "p99.5", "0,0,10,20", " MEAN "])
def test_anchors_are_read_and_written(text: str) -> None:
    anchor = GreyAnchor.parse(text)
    assert str(anchor) == text.strip().lower()
    assert GreyAnchor.parse(str(anchor)) == anchor
    assert str(anchor) in reflectance_text(text)


@pytest.mark.parametrize(
    "text",
    ["", "p", "p0", "p101", "pnan", "median", "1,2,3", "5,5,5,9", "-1,0,4,4", "0,0,1.5,2", "9" * 10**5],
)
def test_bad_anchors_are_named(text: str) -> None:
    with pytest.raises(ValueError, match=r"grey_anchor = .*must be mean, pNN") as told:
        GreyAnchor.parse(text)
    assert len(str(told.value)) < 300


def test_an_anchor_without_light_or_outside_is_refused() -> None:
    dark = torch.zeros(1, 3, 20, 30)
    with pytest.raises(ValueError, match="grey_anchor = mean: is black"):
        simulate(dark, CAMERA, **CONDITIONS, grey_anchor="mean")
    with pytest.raises(ValueError, match="outside the picture of 30 x 20 px"):
        simulate(dark + 0.5, CAMERA, **CONDITIONS, grey_anchor="0,0,20,30")
    assert np.isfinite(float(simulate(dark + 1e-3, CAMERA, **CONDITIONS, grey_anchor="mean").mean()))
