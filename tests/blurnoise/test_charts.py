"""Charts: areas and closed forms of edges, stars and signs, boxes, and refusals."""

import math
import re

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import avg_pool2d

from blurnoise.charts import (
    SIGN_RED,
    SIGN_WHITE,
    flat_patch,
    siemens_star,
    slanted_edge,
    stop_sign,
    stop_sign_box,
    stop_sign_text_box,
)

angles = st.floats(-720, 720)
sizes = st.integers(1, 40)


def sign_shares(picture, background):
    """White and red share of each pixel, solved from the three colour channels."""
    colours = torch.tensor([SIGN_WHITE, SIGN_RED], dtype=torch.float64).T - background
    contrast = (picture[0].double() - background).reshape(3, -1)
    white, red = torch.linalg.lstsq(colours, contrast).solution
    return white.reshape(picture.shape[-2:]), red.reshape(picture.shape[-2:])


def centred(n):
    return torch.arange(n, dtype=torch.float64) + 0.5 - n / 2


@pytest.mark.parametrize(
    ("picture", "shape"),
    [
        (slanted_edge(3, 5), (1, 1, 3, 5)),
        (siemens_star(8.5), (1, 1, 9, 9)),
        (siemens_star(8, height_px=7, width_px=11), (1, 1, 7, 11)),
        (stop_sign(5), (1, 3, 10, 10)),
        (stop_sign(5, height_px=7, width_px=11), (1, 3, 7, 11)),
    ],
)
def test_pictures_are_float32_reflectance_of_the_asked_shape(picture, shape):
    assert (picture.shape, picture.dtype) == (shape, torch.float32)
    assert 0 <= picture.min() <= picture.max() <= 1
    assert torch.equal(flat_patch(3, 5), torch.full((1, 1, 3, 5), 0.18))


def counted_edge(height_px, width_px, angle_deg, n):
    """The bright half-plane counted on n² points per pixel; at 0° the bright side is the right one."""
    y, x = (
        (torch.arange(size * n, dtype=torch.float64) + 0.5) / n - size / 2 for size in (height_px, width_px)
    )
    angle = math.radians(angle_deg)
    bright = x * math.cos(angle) - y[:, None] * math.sin(angle)
    return avg_pool2d((bright > 0).double()[None] + 0.5 * (bright == 0), n)[0]


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, -5.0, 37.0, 90.0, 95.0, 185.0, -130.0])
def test_edge_is_the_area_found_by_supersampling(angle_deg):
    picture = slanted_edge(11, 16, angle_deg=angle_deg, dark=0.0, bright=1.0)[0, 0].double()
    torch.testing.assert_close(picture, counted_edge(11, 16, angle_deg, 64), rtol=0, atol=1e-3)


@given(sizes, sizes, angles)
@settings(deadline=None)
def test_edge_divides_the_picture_in_equal_halves(height_px, width_px, angle_deg):
    picture = slanted_edge(height_px, width_px, angle_deg=angle_deg, dark=0.25, bright=0.75).double()
    assert picture.mean().item() == pytest.approx(0.5, abs=1e-7)
    torch.testing.assert_close(picture + picture.flip(2, 3), torch.ones_like(picture), rtol=0, atol=1e-6)


def test_star_is_a_cosine_of_the_polar_angle():
    cycles, size_px = 36, 300
    picture = siemens_star(size_px, height_px=301, width_px=320, angle_deg=4, dark=0, bright=1)[0, 0].double()
    y, x = centred(301)[:, None], centred(320)[None, :]
    r, phi = torch.hypot(x, y), torch.atan2(-y, x)
    # A pixel averages, nearly, a plane wave of cycles/(2 pi r) cycles/px along the tangent: sinc in x and y.
    f = cycles / (2 * math.pi * r)
    pixel = torch.sinc(f * y / r) * torch.sinc(f * x / r)
    expected = 0.5 + 0.5 * torch.cos(cycles * (phi - math.radians(4))) * pixel
    ring = (r > 40) & (r < 148)
    assert (picture - expected)[ring].abs().max() < 2e-3
    assert (picture - 0.5)[r > 151].abs().max() == 0


@given(st.floats(5, 60), angles, st.floats(0, 0.6), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=25, deadline=None)
def test_sign_has_the_area_and_centre_of_its_octagon(size_px, angle_deg, background, dx, dy):
    centre = 37 + dx, 42 + dy
    picture = stop_sign(
        size_px, height_px=83, width_px=77, angle_deg=angle_deg, centre_px=centre, background=background
    )
    assert 0 <= picture.min() <= picture.max() <= 1
    share = sum(sign_shares(picture, background))
    r = size_px / 2
    # Points 1/8 px apart misplace the outline by 1/16 px at most; at worst all to the same side, as at 0°.
    outline = 16 * (math.sqrt(2) - 1) * r
    assert share.sum().item() == pytest.approx(8 * (math.sqrt(2) - 1) * r**2, abs=outline / 16)
    x, y = torch.arange(77) + 0.5, torch.arange(83)[:, None] + 0.5
    found = (share * x).sum() / share.sum(), (share * y).sum() / share.sum()
    assert math.dist((float(found[0]), float(found[1])), centre) < 1 / 8


def test_sign_before_a_picture_covers_what_it_covers_of_grey():
    """Every pixel is the share of white, of red and of what is behind; the picture behind stays as it was."""
    behind = torch.rand((1, 3, 61, 73), generator=torch.Generator().manual_seed(1))
    kept, at = behind.clone(), {"size_px": 31.3, "angle_deg": 8.0, "centre_px": (30.2, 33.7)}
    seen = stop_sign(**at, background=behind)
    assert torch.equal(behind, kept)
    white, red = sign_shares(stop_sign(**at, height_px=61, width_px=73, background=0.0), 0.0)
    sign = sum(torch.tensor(c)[:, None, None] * own for c, own in ((SIGN_WHITE, white), (SIGN_RED, red)))
    expected = sign + behind[0] * (1 - white - red)
    torch.testing.assert_close(seen[0].double(), expected.double(), atol=1e-5, rtol=0)


LETTERS = {"S": (-9.15, 2.65), "T": (-3.25, 2.4), "O": (2.65, 2.75), "P": (9.15, 2.65)}
"""Of the drawing, in inches on the 30 in sign: centre x, half width."""


def test_white_is_the_border_and_four_letters_10_in_high():
    px_per_in = 20
    white, red = sign_shares(stop_sign(600, height_px=600, width_px=600, supersample=4), 0.18)
    y, x = centred(600)[:, None] / px_per_in, centred(600)[None, :] / px_per_in
    octagon = torch.maximum(torch.maximum(x.abs(), y.abs()), (x.abs() + y.abs()) / math.sqrt(2))
    face = octagon < 14.2
    border = white[~face].sum().item() / px_per_in**2
    assert border == pytest.approx(8 * (math.sqrt(2) - 1) * (15**2 - 14.25**2), rel=0.01)
    legend = white * face
    rows = legend.sum(1).gt(0.5).nonzero() + 0.5
    ends_in = [float(end - 300) / px_per_in for end in (rows.min(), rows.max())]
    assert ends_in == pytest.approx([-5, 5], abs=0.05)
    assert red[face & (y.abs() > 5.1)].min() == pytest.approx(1, abs=1e-5)
    for centre, half in LETTERS.values():
        letter = legend * ((x - centre).abs() < half + 0.3)
        assert letter.sum(0).gt(0.5).sum() / px_per_in == pytest.approx(2 * half, abs=0.1)


GLYPHS = {
    "S": {-4.3: " # ", -1.8: "#..", 0.0: ".#.", 1.8: "..#", 4.3: " # "},
    "T": {-4.3: "###", -1.8: ".#.", 0.0: ".#.", 1.8: ".#.", 4.3: ".#."},
    "O": {-4.3: " # ", -1.8: "#.#", 0.0: "#.#", 1.8: "#.#", 4.3: " # "},
    "P": {-4.3: "## ", -2.1: "#.#", 0.1: "## ", 2.3: "#..", 4.3: "#.."},
}


@pytest.mark.parametrize("angle_deg", [0, 30, -100])
@pytest.mark.parametrize(("size_px", "contrast"), [(200, 0.95), (32, 0.6)])
def test_legend_reads_stop(size_px, contrast, angle_deg):
    white, _ = sign_shares(stop_sign(size_px, height_px=220, width_px=250, angle_deg=angle_deg), 0.18)
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    for name, glyph in GLYPHS.items():
        centre, half = LETTERS[name]
        shares: dict[str, list[float]] = {"#": [], ".": [], " ": []}
        for v, marks in glyph.items():
            for u, mark in zip((centre - half + 0.7, centre, centre + half - 0.7), marks, strict=True):
                # Right is (cos, -sin) and down is (sin, cos): counter-clockwise with y down.
                x, y = (u * cos + v * sin) * size_px / 30 + 125, (v * cos - u * sin) * size_px / 30 + 110
                shares[mark].append(white[int(y), int(x)].item())
        ink, gap = (torch.tensor(shares[mark]) for mark in "#.")
        assert ink.mean() - gap.mean() > contrast, name
        assert size_px != 200 or ink.min() > 0.95 > 0.05 > gap.max(), name


@given(st.floats(1, 40), angles, st.floats(-5, 5), st.floats(-5, 5))
@settings(deadline=None)
def test_box_holds_the_eight_corners(size_px, angle_deg, dx, dy):
    centre = 28 + dx, 30 + dy
    box = stop_sign_box(size_px, height_px=60, width_px=56, angle_deg=angle_deg, centre_px=centre)
    radius = size_px / 2 / math.cos(math.pi / 8)
    corners = [math.radians(angle_deg) + (k + 0.5) * math.pi / 4 for k in range(8)]
    x = [centre[0] + radius * math.cos(corner) for corner in corners]
    y = [centre[1] - radius * math.sin(corner) for corner in corners]
    assert box == pytest.approx((min(x), min(y), max(x), max(y)), abs=1e-9)


@pytest.mark.parametrize(("size_px", "height_px", "width_px"), [(60.5, 83, 77), (9.0, 9, 9)])
def test_text_box_is_tight_around_the_word(size_px, height_px, width_px):
    white, _ = sign_shares(stop_sign(size_px, height_px=height_px, width_px=width_px, supersample=16), 0.18)
    x, y = centred(width_px).abs() * 30 / size_px, centred(height_px).abs()[:, None] * 30 / size_px
    reach = torch.maximum(torch.maximum(x, y), (x + y) / math.sqrt(2))
    legend = white * (reach < 14.25 - 30 / size_px)  # without the border and the pixels that it touches
    box = stop_sign_text_box(size_px, height_px=height_px, width_px=width_px)
    columns, rows = (legend.amax(axis).gt(1e-3).nonzero().flatten() + 0.5 for axis in (0, 1))
    # The letters' flat ends are drawn exactly; of the S's round left, the last 1/16 px may go unsampled.
    assert [*map(float, (columns[0], rows[0], columns[-1], rows[-1]))] == pytest.approx(box, abs=0.6)
    centre = width_px / 2, height_px / 2
    assert ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2) == pytest.approx(centre)
    larger = {"height_px": height_px + 50, "width_px": width_px + 50}
    assert stop_sign_text_box(size_px, **larger, centre_px=centre) == pytest.approx(box)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: slanted_edge(5, 5, dark=0.9), "dark = 0.9: must be finite and >= 0 and <= 0.8"),
        (lambda: stop_sign(5, background=torch.zeros(1, 1, 9, 9)), "(1, 3, 9, 9), got"),
        (lambda: stop_sign(5, height_px=8, background=torch.zeros(1, 3, 9, 9)), "(1, 3, 8, 9)"),
        (lambda: stop_sign(5, background=torch.full((1, 3, 9, 9), 1.5)), "spans [1.5, 1.5]"),
        (lambda: stop_sign(5, background=torch.zeros(1, 3, 9, 9).byte()), "background: must be float"),
        (lambda: stop_sign(5, centre_px=(2, 5)), "inside the picture, 10 x 10 px"),
        (lambda: stop_sign_box(20, height_px=20, width_px=20, angle_deg=10), "inside the picture"),
        (lambda: stop_sign_text_box(25, height_px=20, width_px=30), "inside the picture, 30 x 20 px"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises((TypeError, ValueError), match=re.escape(message)):
        call()


def test_a_sign_is_drawn_the_same_again_whatever_became_of_the_first():
    first = stop_sign(21.5)
    expected = first.clone()
    first.zero_()
    assert torch.equal(stop_sign(21.5), expected)
    assert not torch.equal(stop_sign(21.5, angle_deg=10.0), expected)
    assert not torch.equal(stop_sign(21.5, centre_px=(21.0, 22.5)), expected)
