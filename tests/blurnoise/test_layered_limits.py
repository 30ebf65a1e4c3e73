"""Layers where they are known to be something simpler: everywhere, nowhere, at rest, moving alike, at the border."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from layered_scenes import BACKGROUND, MATTE, OBJECT, SIZE, STILL, Motion, close, seen

from blurnoise import Layer, expose_layers, motion_blur
from blurnoise.blur.layers import seen_behind


@pytest.mark.parametrize("border", ["reflect", "replicate", "circular"])
@pytest.mark.parametrize("background", [STILL, (9.0, -4.0)])
def test_an_object_that_is_everywhere_is_a_picture_in_motion(border: str, background: Motion) -> None:
    moved = (14.0, 7.5)
    layer = Layer(OBJECT, torch.ones(SIZE, dtype=torch.float64), moved)
    found = expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=background, border=border)
    close(found, motion_blur(OBJECT[None], moved, border=border), 2e-3)


def test_an_object_that_is_nowhere_leaves_the_background() -> None:
    moved = (9.0, -4.0)
    none = torch.zeros(SIZE, dtype=torch.float64)
    close(seen((14.0, 7.5), moved, alpha=none), motion_blur(BACKGROUND[None], moved))
    assert expose_layers(BACKGROUND[None], [], exposure_s=1.0) is not None


def test_at_rest_it_is_the_composite() -> None:
    composite = (OBJECT * MATTE + (1 - MATTE) * BACKGROUND)[None]
    close(seen(STILL, STILL), composite)
    close(expose_layers(BACKGROUND[None], [Layer(OBJECT, MATTE, (500.0, 0.0))], exposure_s=0.0), composite)


@pytest.mark.parametrize("moved", [(12.0, 0.0), (7.0, -9.0)])
def test_equal_motion_is_that_of_the_composite(moved: Motion) -> None:
    composite = (OBJECT * MATTE + (1 - MATTE) * BACKGROUND)[None]
    close(seen(moved, moved), motion_blur(composite, moved))


def test_before_an_even_background_the_whole_picture_may_be_blurred() -> None:
    even = torch.full_like(BACKGROUND, 0.3)[None]
    found = expose_layers(
        even, [Layer(OBJECT, MATTE, (16.0, 4.0))], exposure_s=1.0, velocity_px_s=(-8.0, 3.0)
    )
    whole = motion_blur((OBJECT * MATTE)[None] + (1 - MATTE) * even, (16.0, 4.0))
    # but for a matte that rings, which is kept within [0, 1]
    a = motion_blur(MATTE[None, None], (16.0, 4.0))
    ringing = float(torch.maximum(a - 1, -a).amax())
    assert ringing < 0.03
    close(found, whole, 0.3 * ringing + 1e-5)


def test_the_rest_of_the_picture_is_untouched() -> None:
    """Beyond the window nothing differs, to the last bit, whether or not the background moves."""
    rows, columns = slice(30, 60), slice(44, 74)
    layer = Layer(OBJECT[:, rows, columns], MATTE[rows, columns], (10.0, 0.0), (44, 30))
    for background in (STILL, (5.0, 2.0)):
        plain = motion_blur(BACKGROUND[None], background)
        found = expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=background)
        assert bool((found[..., :20] == plain[..., :20]).all())
        assert bool((found[..., 90:] == plain[..., 90:]).all())
        assert bool((found != plain)[..., 40:50, 50:60].any())


def test_the_windows_are_the_pictures() -> None:
    """A cut-out matte and one of the picture's size are the same object."""
    rows, columns = slice(30, 60), slice(44, 74)
    small = Layer(OBJECT[:, rows, columns], MATTE[rows, columns], (11.0, 6.0), (44, 30))
    for background in (STILL, (5.0, 2.0)):
        found = expose_layers(BACKGROUND[None], [small], exposure_s=1.0, velocity_px_s=background)
        close(found, seen((11.0, 6.0), background), 2e-4)


def test_what_lies_outside_comes_in_and_what_meets_the_border_goes_on() -> None:
    black = torch.zeros(1, 1, 40, 61, dtype=torch.float64)
    white = torch.ones(1, 10, 10, dtype=torch.float64)
    outside = Layer(white, white[0], (40.0, 0.0), (-12, 15))
    found = expose_layers(black, [outside], exposure_s=1.0)
    assert float(found[0, 0, 20, 0]) == pytest.approx(
        0.25, abs=0.02
    )  # it covers -12 to -2; 10 of 40 px pass over 0
    far = Layer(white, white[0], (4.0, 0.0), (-100, 15))
    assert float(expose_layers(black, [far], exposure_s=1.0).abs().max()) == 0.0
    beside = Layer(white, white[0], (8.0, 0.0), (0, 15))
    edge = expose_layers(black, [beside], exposure_s=1.0)[0, 0, 20, 0]
    assert float(edge) == pytest.approx(1.0, abs=0.03)  # there is more of it beyond the border
    apart = Layer(white, white[0], (8.0, 0.0), (1, 15))
    assert float(expose_layers(black, [apart], exposure_s=1.0)[0, 0, 20, 1]) == pytest.approx(0.56, abs=0.03)


@pytest.mark.parametrize("background", [(0.0, 0.0), (3.0, 2.0)])
def test_empty_margins_of_a_layer_are_nothing(background: Motion) -> None:
    """One as large as the picture is the object alone: nothing goes on beyond a border that the matte does not meet.

    Mirrored there, it would come in again from outside: 0.4 of white at the edge.
    """
    white = torch.ones(1, 10, 12, dtype=torch.float64)
    tight = Layer(white, white[0], (24.0, 0.0), (46, 15))
    whole = torch.zeros(1, 40, 61, dtype=torch.float64)
    whole[:, 15:25, 46:58] = 1
    black = torch.zeros(1, 1, 40, 61, dtype=torch.float64)
    given: dict[str, Any] = {"exposure_s": 1.0, "velocity_px_s": background}
    alone = expose_layers(black, [tight], **given)
    large = Layer(whole, whole[0], (24.0, 0.0))
    assert torch.equal(expose_layers(black, [large], **given), alone)
    assert float(alone[0, 0, 20, 60]) == pytest.approx(0.38, abs=0.03)  # it leaves: 9 of 24 px of way
    whole_share, share = (seen_behind(each, [(each, (24.0, 0.0))], (40, 61)) for each in (large, tight))
    assert whole_share == share
    nowhere = Layer(white, 0 * white[0], (24.0, 0.0), (46, 15))
    assert torch.equal(expose_layers(black, [nowhere], **given), black)
