from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise import charts
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


def sign_shares(picture: Tensor, background: float) -> tuple[Tensor, Tensor]:
    """White and red share of each pixel, solved from the three colour channels."""
    colours = torch.tensor([SIGN_WHITE, SIGN_RED], dtype=torch.float64).T - background
    contrast = (picture[0].double() - background).reshape(3, -1)
    white, red = torch.linalg.lstsq(colours, contrast).solution
    return white.reshape(picture.shape[-2:]), red.reshape(picture.shape[-2:])


def centred(n: int) -> Tensor:
    return torch.arange(n, dtype=torch.float64) + 0.5 - n / 2


# --- every target ----------------------------------------------------------


@pytest.mark.parametrize(
    ("picture", "shape"),
    [
        (flat_patch(3, 5), (1, 1, 3, 5)),
        (slanted_edge(3, 5), (1, 1, 3, 5)),
        (siemens_star(8.5), (1, 1, 9, 9)),
        (siemens_star(8, height_px=7, width_px=11), (1, 1, 7, 11)),
        (stop_sign(5), (1, 3, 10, 10)),
        (stop_sign(5, height_px=7, width_px=11), (1, 3, 7, 11)),
    ],
)
def test_pictures_are_float32_reflectance_of_the_asked_shape(picture: Tensor, shape: tuple[int, ...]) -> None:
    assert picture.shape == shape
    assert picture.dtype == torch.float32
    assert 0 <= picture.min() <= picture.max() <= 1


def test_flat_patch_is_18_percent_grey_by_default() -> None:
    assert torch.equal(flat_patch(3, 5), torch.full((1, 1, 3, 5), 0.18))
    assert flat_patch(1, 1, reflectance=0.5).item() == 0.5


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, -17.0, 45.0, 100.0, 200.0])
def test_turning_by_90_degrees_is_rot90(angle_deg: float) -> None:
    def turned(picture: Tensor) -> Tensor:
        return torch.rot90(picture, 1, (2, 3))  # counter-clockwise as displayed

    edge = turned(slanted_edge(33, 20, angle_deg=angle_deg))
    torch.testing.assert_close(slanted_edge(20, 33, angle_deg=angle_deg + 90), edge, rtol=0, atol=1e-6)

    star = turned(siemens_star(30, height_px=33, width_px=21, angle_deg=angle_deg, cycles=7))
    again = siemens_star(30, height_px=21, width_px=33, angle_deg=angle_deg + 90, cycles=7)
    torch.testing.assert_close(again, star, rtol=0, atol=1e-5)

    # The sample grid turns into itself: only points within rounding of a border change, one of 8² at most.
    sign = turned(stop_sign(37, height_px=63, width_px=44, angle_deg=angle_deg))
    again = stop_sign(37, height_px=44, width_px=63, angle_deg=angle_deg + 90)
    torch.testing.assert_close(again, sign, rtol=0, atol=1.01 / 64)
    assert (again - sign).abs().mean() < 1e-4


def test_twice_the_size_averaged_by_two_is_the_same_picture() -> None:
    torch.testing.assert_close(avg_pool2d(slanted_edge(50, 74), 2), slanted_edge(25, 37), rtol=0, atol=1e-6)
    small = {"height_px": 45, "width_px": 55, "angle_deg": 13.0}
    large = {"height_px": 90, "width_px": 110, "angle_deg": 13.0}
    # 4² points in each of four pixels are the same points as 8² in one.
    sign = avg_pool2d(stop_sign(80, **large, supersample=4), 2)
    torch.testing.assert_close(sign, stop_sign(40, **small), rtol=0, atol=1.01 / 64)
    star = avg_pool2d(siemens_star(80, **large, supersample=4), 2)
    torch.testing.assert_close(star, siemens_star(40, **small), rtol=0, atol=1e-3)
    # With four times the points it is the same but for the sampling error: each of a pixel's 8 rows is off by
    # up to 1/16 px where an edge cuts it, independently for a slanted edge: rms 1/8/sqrt(12)/sqrt(8) = 0.013.
    sign = avg_pool2d(stop_sign(80, **large), 2)
    assert (sign - stop_sign(40, **small)).abs().max() < 0.05


def test_row_blocks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stop_sign(21, angle_deg=10), siemens_star(21)
    monkeypatch.setattr(charts, "_POINTS_PER_BLOCK", 1)  # one row of pixels at a time
    assert torch.equal(stop_sign(21, angle_deg=10), whole[0])
    assert torch.equal(siemens_star(21), whole[1])


# --- slanted edge ----------------------------------------------------------


def counted_edge(height_px: int, width_px: int, angle_deg: float, n: int) -> Tensor:
    """The bright half-plane counted on n² points per pixel; at 0° the bright side is the right one."""
    y, x = (
        (torch.arange(size * n, dtype=torch.float64) + 0.5) / n - size / 2 for size in (height_px, width_px)
    )
    angle = math.radians(angle_deg)
    bright = x * math.cos(angle) - y[:, None] * math.sin(angle)
    return avg_pool2d((bright > 0).double()[None] + 0.5 * (bright == 0), n)[0]


@pytest.mark.parametrize("angle_deg", [5.0, -5.0, 22.5, 37.0, 68.0, 95.0, 185.0, -130.0])
def test_edge_is_the_area_found_by_supersampling(angle_deg: float) -> None:
    picture = slanted_edge(11, 16, angle_deg=angle_deg, dark=0.0, bright=1.0)[0, 0].double()
    torch.testing.assert_close(picture, counted_edge(11, 16, angle_deg, 64), rtol=0, atol=1e-3)


@given(sizes, sizes, angles)
@settings(max_examples=50, deadline=None)
def test_edge_is_the_area_at_every_angle(height_px: int, width_px: int, angle_deg: float) -> None:
    picture = slanted_edge(height_px, width_px, angle_deg=angle_deg, dark=0.0, bright=1.0)[0, 0].double()
    # A row (or column) of n points misplaces the edge by half a step at most, 1/(2n): reached by an edge
    # that is parallel to the grid.
    expected = counted_edge(height_px, width_px, angle_deg, 16)
    assert (picture - expected).abs().max() <= 0.5 / 16 + 1e-6


@given(sizes, sizes, angles)
@settings(deadline=None)
def test_edge_divides_the_picture_in_equal_halves(height_px: int, width_px: int, angle_deg: float) -> None:
    picture = slanted_edge(height_px, width_px, angle_deg=angle_deg, dark=0.25, bright=0.75).double()
    assert picture.mean().item() == pytest.approx(0.5, abs=1e-7)
    torch.testing.assert_close(picture + picture.flip(2, 3), torch.ones_like(picture), rtol=0, atol=1e-6)


def test_edge_without_slant_is_exact() -> None:
    assert slanted_edge(1, 5, angle_deg=0, dark=0, bright=1).flatten().tolist() == [0, 0, 0.5, 1, 1]
    assert slanted_edge(4, 1, angle_deg=90, dark=0, bright=1).flatten().tolist() == [1, 1, 0, 0]
    picture = slanted_edge(8, 8, angle_deg=45, dark=0, bright=1)[0, 0]
    torch.testing.assert_close(picture.diagonal(), torch.full((8,), 0.5))
    assert (picture.triu(1) + picture.tril(-1)).sum() == 28  # above the diagonal 1, below 0


def test_edge_turns_counter_clockwise() -> None:
    upright, slanted = slanted_edge(40, 30, angle_deg=0)[0, 0], slanted_edge(40, 30, angle_deg=5)[0, 0]
    assert upright[20, 0] < upright[20, -1]  # bright on the right
    assert slanted[0].sum() > upright[0].sum() > slanted[-1].sum()  # its upper end has moved left
    up = slanted_edge(40, 30, angle_deg=90)[0, 0]
    assert up[0, 15] > up[-1, 15]  # right has become up


# --- Siemens star ----------------------------------------------------------


def test_star_is_a_cosine_of_the_polar_angle() -> None:
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


def test_star_turns_counter_clockwise() -> None:
    row, column = 50, slice(80, 100)
    upright, turned = siemens_star(101, cycles=4)[0, 0], siemens_star(101, cycles=4, angle_deg=10)[0, 0]
    assert upright[row, column].min() > 0.79  # a bright spoke points right
    offset = round(35 * math.tan(math.radians(10)))
    assert turned[row - offset, 50 + 35] > 0.79 > 0.6 > turned[row + offset, 50 + 35]


def test_star_hub_and_mean_are_the_mean_reflectance() -> None:
    picture = siemens_star(201, cycles=36, dark=0.2, bright=0.6)
    assert picture.mean().item() == pytest.approx(0.4, abs=1e-4)
    assert picture[0, 0, 100, 100].item() == pytest.approx(0.4)
    # One point per pixel resolves no more than 1/2 cycle/px, found at r = 36/pi = 11.46 px.
    coarse = siemens_star(201, cycles=36, dark=0.2, bright=0.6, supersample=1)[0, 0]
    r = torch.hypot(centred(201)[:, None], centred(201)[None, :])
    assert (coarse - 0.4)[r < 11.4].abs().max() < 1e-6
    assert (coarse - 0.4)[(r > 11.5) & (r < 13)].std() > 0.1


def test_star_has_converged() -> None:
    coarse, fine = siemens_star(60, cycles=24), siemens_star(60, cycles=24, supersample=40)
    assert (coarse - fine).abs().max() < 0.02
    assert (siemens_star(60, cycles=24, supersample=1) - fine).abs().max() > 0.1


# --- stop sign -------------------------------------------------------------


@given(st.floats(5, 60), angles, st.floats(0, 0.6), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=25, deadline=None)
def test_sign_has_the_area_and_centre_of_its_octagon(
    size_px: float, angle_deg: float, background: float, dx: float, dy: float
) -> None:
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


def test_sign_before_a_picture_covers_what_it_covers_of_grey() -> None:
    """Every pixel is the share of white, of red and of what is behind; the picture behind stays as it was."""
    generator = torch.Generator().manual_seed(1)
    behind = torch.rand((1, 3, 61, 73), generator=generator)
    kept, at = behind.clone(), {"size_px": 31.3, "angle_deg": 8.0, "centre_px": (30.2, 33.7)}
    seen = stop_sign(**at, background=behind)  # type: ignore[arg-type]
    assert torch.equal(behind, kept)
    assert seen.shape == behind.shape
    white, red = sign_shares(stop_sign(**at, height_px=61, width_px=73, background=0.0), 0.0)  # type: ignore[arg-type]
    expected = (
        torch.tensor(SIGN_WHITE)[:, None, None] * white
        + torch.tensor(SIGN_RED)[:, None, None] * red
        + behind[0] * (1 - white - red)
    )
    torch.testing.assert_close(seen[0].double(), expected.double(), atol=1e-5, rtol=0)
    grey = stop_sign(**at, height_px=61, width_px=73, background=0.3)  # type: ignore[arg-type]
    same = stop_sign(**at, background=torch.full((1, 3, 61, 73), 0.3))  # type: ignore[arg-type]
    torch.testing.assert_close(same, grey, atol=1e-6, rtol=0)


def test_text_box_goes_with_the_sign() -> None:
    frame = {"height_px": 90, "width_px": 100}
    middle, moved = (
        stop_sign_text_box(60, **frame, centre_px=centre) for centre in ((50.0, 45.0), (61.5, 39.25))
    )
    assert middle == stop_sign_text_box(60, **frame)
    assert [b - a for a, b in zip(middle, moved, strict=True)] == pytest.approx([11.5, -5.75, 11.5, -5.75])


# The drawing, in inches on the 30 in sign: letter, centre x, half width, area.
_S_TURN = math.asin(1.95 / 2.35)  # slope of the S's spine, against the vertical
LETTERS = {
    "S": (
        -9.15,
        2.65,
        (math.pi + _S_TURN) * (2.65**2 - 1.25**2) + 2 * 1.4 * 2.35 * math.cos(_S_TURN),  # arcs, spine
    ),
    "T": (-3.25, 2.4, 1.4 * 4.8 + 1.4 * 8.6),  # bar, stem
    "O": (2.65, 2.75, math.pi * (2.75**2 - 1.35**2) + 2 * 1.4 * 4.5),  # half circles, sides
    "P": (9.15, 2.65, 1.4 * 10 + 2 * 1.4 * 1.0 + math.pi / 2 * (2.9**2 - 1.5**2)),  # stem, bars, half circle
}


def test_white_is_the_border_and_four_letters_10_in_high() -> None:
    px_per_in = 20
    white, red = sign_shares(stop_sign(600, height_px=600, width_px=600, supersample=4), 0.18)
    y, x = centred(600)[:, None] / px_per_in, centred(600)[None, :] / px_per_in
    octagon = torch.maximum(torch.maximum(x.abs(), y.abs()), (x.abs() + y.abs()) / math.sqrt(2))
    face = octagon < 14.2
    border = white[~face].sum().item() / px_per_in**2
    assert border == pytest.approx(8 * (math.sqrt(2) - 1) * (15**2 - 14.25**2), rel=0.01)
    legend = white * face
    rows = legend.sum(1).gt(0.5).nonzero() + 0.5
    assert (rows.min() - 300) / px_per_in == pytest.approx(-5, abs=0.05)
    assert (rows.max() - 300) / px_per_in == pytest.approx(5, abs=0.05)
    assert red[face & (y.abs() > 5.1)].min() == pytest.approx(1, abs=1e-5)
    for centre, half, area in LETTERS.values():
        columns = ((x - centre).abs() < half + 0.3).expand_as(legend)
        letter = legend * columns
        assert letter.sum().item() / px_per_in**2 == pytest.approx(area, rel=0.01)
        assert letter.sum(0).gt(0.5).sum() / px_per_in == pytest.approx(2 * half, abs=0.1)
    assert sum(area for *_, area in LETTERS.values()) == pytest.approx(
        legend.sum().item() / px_per_in**2, rel=0.01
    )


# Columns: left stroke, middle, right stroke; rows: y in inches. White (#), red (.) or a round corner (space).
GLYPHS = {
    "S": {-4.3: " # ", -1.8: "#..", 0.0: ".#.", 1.8: "..#", 4.3: " # "},
    "T": {-4.3: "###", -1.8: ".#.", 0.0: ".#.", 1.8: ".#.", 4.3: ".#."},
    "O": {-4.3: " # ", -1.8: "#.#", 0.0: "#.#", 1.8: "#.#", 4.3: " # "},
    "P": {-4.3: "## ", -2.1: "#.#", 0.1: "## ", 2.3: "#..", 4.3: "#.."},
}


@pytest.mark.parametrize("angle_deg", [0, 30, 90, -100])
@pytest.mark.parametrize(("size_px", "contrast"), [(200, 0.95), (100, 0.9), (50, 0.75), (32, 0.6)])
def test_legend_reads_stop(size_px: int, contrast: float, angle_deg: float) -> None:
    white, _ = sign_shares(stop_sign(size_px, height_px=220, width_px=250, angle_deg=angle_deg), 0.18)
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    for name, glyph in GLYPHS.items():
        centre, half, _ = LETTERS[name]
        shares: dict[str, list[float]] = {"#": [], ".": [], " ": []}
        for v, marks in glyph.items():
            for u, mark in zip((centre - half + 0.7, centre, centre + half - 0.7), marks, strict=True):
                # Right is (cos, -sin) and down is (sin, cos): counter-clockwise with y down.
                x, y = (u * cos + v * sin) * size_px / 30 + 125, (v * cos - u * sin) * size_px / 30 + 110
                shares[mark].append(white[int(y), int(x)].item())
        ink, gap = (torch.tensor(shares[mark]) for mark in "#.")
        assert ink.mean() - gap.mean() > contrast, name
        if size_px == 200:
            assert ink.min() > 0.95 > 0.05 > gap.max(), name


@given(st.floats(1, 40), angles, st.floats(-5, 5), st.floats(-5, 5))
@settings(deadline=None)
def test_box_holds_the_eight_corners(size_px: float, angle_deg: float, dx: float, dy: float) -> None:
    centre = 28 + dx, 30 + dy
    box = stop_sign_box(size_px, height_px=60, width_px=56, angle_deg=angle_deg, centre_px=centre)
    radius = size_px / 2 / math.cos(math.pi / 8)
    corners = [math.radians(angle_deg) + (k + 0.5) * math.pi / 4 for k in range(8)]
    x = [centre[0] + radius * math.cos(corner) for corner in corners]
    y = [centre[1] - radius * math.sin(corner) for corner in corners]
    assert box == pytest.approx((min(x), min(y), max(x), max(y)), abs=1e-9)


@given(st.floats(8, 40), st.floats(-90, 90), st.floats(-5, 5), st.floats(-5, 5))
@settings(max_examples=40, deadline=None)
def test_box_is_tight_around_the_drawn_sign(size_px: float, angle_deg: float, dx: float, dy: float) -> None:
    placed = {"height_px": 60, "width_px": 56, "angle_deg": angle_deg, "centre_px": (28 + dx, 30 + dy)}
    drawn = (stop_sign(size_px, **placed)[0] != torch.tensor(0.18)).any(0)
    x0, y0, x1, y1 = stop_sign_box(size_px, **placed)
    columns, rows = drawn.any(0).nonzero().flatten(), drawn.any(1).nonzero().flatten()
    # Drawn pixels lie inside the box rounded outwards; a tip that no sample point hits may lack one pixel.
    for first, last, low, high in ((columns[0], columns[-1], x0, x1), (rows[0], rows[-1], y0, y1)):
        assert math.floor(low) <= first <= math.floor(low) + 1
        assert math.ceil(high) - 1 <= last + 1 <= math.ceil(high)


@pytest.mark.parametrize(
    ("size_px", "height_px", "width_px"), [(200.0, 220, 251), (60.5, 83, 77), (9.0, 9, 9)]
)
def test_text_box_is_tight_around_the_word(size_px: float, height_px: int, width_px: int) -> None:
    picture = stop_sign(size_px, height_px=height_px, width_px=width_px, supersample=16)
    white, _ = sign_shares(picture, 0.18)
    x, y = centred(width_px).abs() * 30 / size_px, centred(height_px).abs()[:, None] * 30 / size_px
    reach = torch.maximum(torch.maximum(x, y), (x + y) / math.sqrt(2))
    legend = white * (reach < 14.25 - 30 / size_px)  # without the border and the pixels that it touches
    x0, y0, x1, y1 = stop_sign_text_box(size_px, height_px=height_px, width_px=width_px)
    columns, rows = (legend.amax(axis).gt(1e-3).nonzero().flatten() for axis in (0, 1))
    # The letters' flat ends are drawn exactly; of the S's round left, the last 1/16 px may go unsampled.
    assert abs(columns[0] + 0.5 - x0) <= 0.6
    assert abs(columns[-1] + 0.5 - x1) <= 0.6
    assert abs(rows[0] + 0.5 - y0) <= 0.6
    assert abs(rows[-1] + 0.5 - y1) <= 0.6
    assert (x0 + x1) / 2 == pytest.approx(width_px / 2)
    assert (y0 + y1) / 2 == pytest.approx(height_px / 2)


def test_text_box_refuses_what_the_sign_refuses() -> None:
    with pytest.raises(ValueError, match="inside the picture, 30 x 20 px"):
        stop_sign_text_box(25, height_px=20, width_px=30)
    assert stop_sign_text_box(30) == pytest.approx((30 - 11.8, 25, 30 + 11.8, 35))


def test_sign_may_fill_the_picture_exactly() -> None:
    assert stop_sign_box(0.3 * 10, height_px=3, width_px=3) == pytest.approx((0, 0, 3, 3))
    picture = stop_sign(100, height_px=100, width_px=100)
    assert (picture[0, :, 0, 0] == 0.18).all()
    # A red sheeting is red: its corner-free middle has the face's colour, and little green or blue.
    torch.testing.assert_close(picture[0, :, 90, 50], torch.tensor(SIGN_RED), rtol=0, atol=1e-6)


# --- bad input -------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: flat_patch(0, 5), ValueError, "height_px = 0: must be >= 1"),
        (lambda: flat_patch(5, 2.5), TypeError, "width_px = 2.5: must be an integer"),
        (lambda: flat_patch(5, 5, reflectance=1.1), ValueError, "reflectance = 1.1"),
        (lambda: slanted_edge(5, -1), ValueError, "width_px = -1"),
        (lambda: slanted_edge(True, 5), TypeError, "height_px = True"),
        (lambda: slanted_edge(5, 5, angle_deg=math.nan), ValueError, "angle_deg = nan: must be finite"),
        (lambda: slanted_edge(5, 5, dark=0.9), ValueError, "dark = 0.9: .* <= 0.8"),
        (lambda: slanted_edge(5, 5, bright=1.5), ValueError, "bright = 1.5"),
        (lambda: siemens_star(0), ValueError, "size_px = 0"),
        (lambda: siemens_star(9, cycles=0), ValueError, "cycles = 0"),
        (lambda: siemens_star(9, cycles=7.5), TypeError, "cycles = 7.5"),
        (lambda: siemens_star(9, supersample=0), ValueError, "supersample = 0"),
        (lambda: siemens_star(9, angle_deg=math.inf), ValueError, "angle_deg = inf"),
        (lambda: siemens_star(9, dark=-0.1), ValueError, "dark = -0.1"),
        (lambda: siemens_star(9, height_px=0), ValueError, "height_px = 0"),
        (lambda: stop_sign(-5), ValueError, "size_px = -5"),
        (lambda: stop_sign("big"), TypeError, "size_px = 'big'"),
        (lambda: stop_sign(5, background=-0.1), ValueError, "background = -0.1"),
        (lambda: stop_sign(5, background=torch.zeros(3, 9, 9)), ValueError, "background: shape must be"),
        (lambda: stop_sign(5, background=torch.zeros(1, 1, 9, 9)), ValueError, r"\(1, 3, 9, 9\), got"),
        (
            lambda: stop_sign(5, height_px=8, background=torch.zeros(1, 3, 9, 9)),
            ValueError,
            r"\(1, 3, 8, 9\)",
        ),
        (lambda: stop_sign(5, background=torch.full((1, 3, 9, 9), 1.5)), ValueError, r"spans \[1.5, 1.5\]"),
        (
            lambda: stop_sign(5, background=torch.zeros(1, 3, 9, 9).byte()),
            TypeError,
            "background: must be float",
        ),
        (lambda: stop_sign(5, supersample=0), ValueError, "supersample = 0"),
        (lambda: stop_sign(5, angle_deg=math.nan), ValueError, "angle_deg = nan"),
        (lambda: stop_sign(5, width_px=0), ValueError, "width_px = 0"),
        (lambda: stop_sign(5, centre_px=(math.inf, 3)), ValueError, "centre_px = inf"),
        (lambda: stop_sign(5, centre_px=(1, 2, 3)), ValueError, r"centre_px = \(1, 2, 3\)"),
        (lambda: stop_sign(5, centre_px=(2, 5)), ValueError, "inside the picture, 10 x 10 px"),
        (
            lambda: stop_sign_box(20, height_px=20, width_px=20, angle_deg=10),
            ValueError,
            "inside the picture",
        ),
    ],
)
def test_bad_input_is_named(call, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        call()
