"""Where a slanted edge cannot be measured: it says so, and gives no plain number."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
import torch
from closed_edges import closed_edge, closed_mtf50
from torch import Tensor
from torch.nn.functional import conv2d, pad

from blurnoise.metrics import Flag, SlantedEdge, slanted_edge

EDGE = closed_edge(100, 120)
MODES = ["exact", "iso"]


@pytest.fixture(autouse=True, scope="module")
def _one_thread() -> Iterator[None]:
    """Pieces this small only wait for each other on several threads."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def noise(shape: tuple[int, ...], deviation: float, seed: int = 0) -> Tensor:
    return deviation * torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def measured(image: Tensor, mode: str = "exact", **options: object) -> SlantedEdge:
    edge = slanted_edge(image, mode=mode, **{"bootstrap": 0, **options})  # type: ignore[arg-type]
    assert isinstance(edge, SlantedEdge)
    return edge


def withheld(edge: SlantedEdge) -> bool:
    """Whether no number at all is given."""
    scalars = (
        edge.mtf50,
        edge.mtf50p,
        edge.mtf_nyquist,
        edge.cnr,
        edge.edge_snr_db,
        edge.michelson,
        edge.bright,
    )
    return all(math.isnan(value) for value in scalars) and edge.sfr.numel() == 0 and not edge.intervals


def moved(x_px: float, **options: object) -> Tensor:
    return closed_edge(100, 120, offset_px=(x_px, 0.0), **options)


NAN, INFINITE = EDGE.clone(), EDGE.clone()
NAN[3, 3], INFINITE[50, 60] = math.nan, math.inf
HOPELESS = {
    "constant": (torch.full((50, 50), 0.5), Flag.NO_EDGE),
    "noise alone": (0.5 + noise((80, 90), 0.01), Flag.NO_EDGE),
    "black": (torch.zeros(50, 50), Flag.CLIPPED),
    "saturated": (torch.ones(50, 50), Flag.CLIPPED),
    "saturated, 8 bit": (torch.full((50, 50), 255, dtype=torch.uint8), Flag.CLIPPED),
    "NaN": (NAN, Flag.NOT_FINITE),
    "infinite": (INFINITE, Flag.NOT_FINITE),
    "bar": (moved(-15) - moved(15) + 0.1, Flag.TWO_EDGES),
    "stairs": ((moved(-20) + moved(20)) / 2, Flag.TWO_EDGES),
    "close stairs": ((moved(-5) + moved(5)) / 2, Flag.TWO_EDGES),
    "noisy stairs": ((moved(-20) + moved(20)) / 2 + noise((100, 120), 0.02), Flag.TWO_EDGES),
    "corner": (torch.maximum(EDGE, closed_edge(100, 120, angle_deg=95.0)), Flag.TWO_EDGES),
    "edge across": (
        EDGE + 0.25 * (closed_edge(100, 120, angle_deg=90.0, offset_px=(0, -10)) - 0.1),
        Flag.TWO_EDGES,
    ),
    "leaves by the side": (closed_edge(100, 100, angle_deg=10.0, offset_px=(47, 0)), Flag.EDGE_LEAVES_REGION),
    "too steep for the region": (closed_edge(100, 60, angle_deg=35.0), Flag.EDGE_LEAVES_REGION),
    "blur as wide as the region": (closed_edge(100, 60, motion_px=(60.0, 0.0)), Flag.REGION_TOO_SMALL),
    "blur as wide, noisy": (
        closed_edge(100, 100, motion_px=(80.0, 0.0)) + noise((100, 100), 0.02),
        Flag.REGION_TOO_SMALL,
    ),
    "hardly any pixels": (closed_edge(8, 8, angle_deg=10.0, sigma_px=0.3), Flag.REGION_TOO_SMALL),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", HOPELESS)
def test_what_cannot_be_measured_is_withheld(name: str, mode: str) -> None:
    image, flag = HOPELESS[name]
    edge = measured(image, mode)
    assert flag in edge.flags
    assert withheld(edge)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("share", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("end", ["bright", "dark"])
def test_clipping_is_withheld_for_it_would_raise_mtf50(share: float, end: str, mode: str) -> None:
    if end == "bright":
        limit = 0.8 - 0.7 * share
        clipped, full_scale = EDGE.clamp(max=limit), limit
    else:
        clipped, full_scale = (EDGE - 0.1 - 0.7 * share).clamp(min=0), 1.0
    for deviation in (0.0, 0.01):
        image = (clipped + noise((100, 120), deviation)).clamp(0, full_scale)
        edge = measured(image, mode, full_scale=full_scale)
        assert edge.flags == {Flag.CLIPPED}
        assert withheld(edge)
    # Its sides told apart from the clip, it is another edge, and sharper: the number that is withheld.
    unseen = measured(clipped + 0.001, mode, full_scale=2.0)
    assert unseen.mtf50 > (1.02 if share < 0.1 else 1.05) * measured(EDGE, mode).mtf50


def test_one_clipped_channel_is_enough() -> None:
    image = torch.stack([EDGE, EDGE / 2, EDGE.clamp(max=0.7) / 0.7])
    assert measured(image).flags == {Flag.CLIPPED}
    image[2] = EDGE / 4
    assert measured(image).flags == frozenset()


def test_a_few_pixels_at_full_scale_do_no_harm() -> None:
    image = EDGE.clone()
    image[::20, 110] = 1.0  # 5 of 12000
    assert measured(image).flags == frozenset()


def test_a_bad_region_harms_no_other() -> None:
    images = torch.stack([EDGE, NAN, torch.ones_like(EDGE), moved(-15) - moved(15) + 0.1, EDGE.flip(1)])[
        :, None
    ]
    edges = slanted_edge(images, bootstrap=20)
    assert isinstance(edges, list)
    assert [withheld(edge) for edge in edges] == [False, True, True, True, False]
    for edge in (edges[0], edges[4]):
        assert edge.mtf50 == pytest.approx(closed_mtf50(), rel=5e-4)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("angle_deg", [0.0, 0.25, 45.0])
def test_too_few_phases(angle_deg: float, mode: str) -> None:
    for x_px in (0.0, 0.2, 0.4):
        image = closed_edge(60, 100, angle_deg=angle_deg, sigma_px=0.3, offset_px=(x_px, 0.0))
        assert measured(image, mode).flags - {Flag.NEVER_REACHES_50} == {Flag.TOO_FEW_PHASES}
    assert measured(closed_edge(60, 100, angle_deg=7.0), mode).flags == frozenset()


@pytest.mark.parametrize("angle_deg", [math.degrees(math.atan(1 / 2)), math.degrees(math.atan(1 / 3))])
def test_iso_lacks_phases_where_the_spline_does_not(angle_deg: float) -> None:
    image = closed_edge(100, 120, angle_deg=angle_deg)
    assert measured(image, "iso").flags == {Flag.TOO_FEW_PHASES}
    assert measured(image).flags == frozenset()


def test_noise_dominates_at_low_contrast() -> None:
    noisy = measured(EDGE + noise((100, 120), 0.7 / 3), full_scale=9.0)
    assert Flag.NOISE_DOMINATED in noisy.flags
    assert Flag.NOISE_DOMINATED not in measured(EDGE + noise((100, 120), 0.7 / 20), full_scale=9.0).flags


def test_response_that_never_falls_to_one_half() -> None:
    """Points instead of pixels: an edge 0.1 px wide, sampled, falls to 50 % far beyond 1 cycle/px."""
    y, x = torch.meshgrid(torch.arange(100.0), torch.arange(100.0), indexing="ij")
    distance = (x - 50 - math.tan(math.radians(5)) * (y - 50)) * math.cos(math.radians(5))
    edge = measured(0.1 + 0.7 * torch.special.ndtr(distance.double() / 0.1), bootstrap=20)
    assert Flag.NEVER_REACHES_50 in edge.flags
    assert math.isnan(edge.mtf50)
    assert edge.mtf_nyquist > 0.9


@pytest.mark.parametrize("deviation", [0.0, 0.02])
def test_sharpening_is_seen(deviation: float) -> None:
    kernel = torch.tensor([[0, -0.25, 0], [-0.25, 2, -0.25], [0, -0.25, 0]], dtype=torch.float64)
    soft = closed_edge(100, 120, sigma_px=0.7)
    sharp = conv2d(pad(soft[None, None], (1, 1, 1, 1), mode="replicate"), kernel[None, None])[0, 0]
    edge = measured(sharp + noise((100, 120), deviation))
    assert edge.flags == {Flag.SHARPENED}
    assert edge.mtf50 > 1.3 * closed_mtf50(sigma_px=0.7)


@pytest.mark.parametrize("blur", [{"sigma_px": 0.5}, {"sigma_px": 1.5}, {"motion_px": (10.0, 0.0)}], ids=str)
def test_a_tone_curve_is_suspected(blur: dict[str, object]) -> None:
    linear = closed_edge(100, 120, **blur)
    for deviation in (0.0, 0.003):
        image = linear + noise((100, 120), deviation)
        assert Flag.NON_LINEAR_SUSPECTED in measured(image ** (1 / 2.2)).flags
        assert measured(image).flags == frozenset()


def test_a_bright_side_quieter_than_the_dark_one_is_suspected() -> None:
    quieter = EDGE + noise((100, 120), 0.01) * torch.where(EDGE > 0.45, 0.6, 1.0)
    louder = EDGE + noise((100, 120), 0.01) * torch.where(EDGE > 0.45, 3.0, 1.0)
    assert measured(quieter).flags == {Flag.NON_LINEAR_SUSPECTED}
    assert measured(louder).flags == frozenset()


@pytest.mark.slow
def test_flags_are_rare_where_nothing_is_wrong() -> None:
    """Of 100 noisy edges of 6 px of motion at CNR 20, one may be flagged."""
    images = closed_edge(100, 100, sigma_px=0.3, motion_px=(6.0, 0.0)) + noise((100, 1, 100, 100), 0.035)
    edges = slanted_edge(images, bootstrap=0, full_scale=9.0)
    assert isinstance(edges, list)
    assert sum(bool(edge.flags) for edge in edges) <= 1


@pytest.mark.parametrize(
    ("image", "options", "error", "match"),
    [
        (EDGE[:1], {}, ValueError, "120 x 1 px; must be at least 8 x 8"),
        (torch.empty(0, 10), {}, ValueError, "none of them 0"),
        (torch.rand(2, 20, 20), {}, ValueError, "1 or 3 channels"),
        (torch.ones(20, 20, dtype=torch.int32), {}, TypeError, "torch.int32"),
        (EDGE.numpy(), {}, TypeError, "ndarray"),
        (EDGE * 4000, {}, ValueError, "above full_scale = 1"),
        (EDGE, {"black_level": 1.0}, ValueError, "below full_scale"),
        (EDGE, {"full_scale": 0.0}, ValueError, "full_scale"),
        (EDGE, {"roi": (100, 0, 40, 40)}, ValueError, "inside the picture, 120 x 100 px"),
        (EDGE, {"mode": "fast"}, ValueError, "'exact', 'iso'"),
        (EDGE, {"bootstrap": -1}, ValueError, "bootstrap"),
    ],
)
def test_wrong_arguments_are_named(
    image: Tensor, options: dict[str, object], error: type[Exception], match: str
) -> None:
    with pytest.raises(error, match=match):
        slanted_edge(image, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("cnr", [0.7, 1.0, 2.0])
def test_noise_leaves_no_number_without_its_flag(cnr: float) -> None:
    """Of 40 edges in heavy noise, those without any flag are right within 30 %; most carry one."""
    generator = torch.Generator().manual_seed(1)
    drawn = torch.randn(40, 1, 100, 100, generator=generator, dtype=torch.float64) * 0.7 / cnr
    found = slanted_edge(closed_edge(100, 100) + drawn + 50, full_scale=999.0)
    assert isinstance(found, list)
    silent = [edge for edge in found if not edge.flags]
    assert len(silent) < 10
    assert all(abs(edge.mtf50 / closed_mtf50() - 1) < 0.3 for edge in silent)


@pytest.mark.parametrize(
    ("length_px", "shape", "offset_px"),
    [(20.23, (107, 107), (-1.0, 40.8)), (27.46, (138, 123), (-30.1, 2.9)), (8.72, (143, 86), (20.9, 38.9))],
)
def test_the_corner_of_a_blurred_square_is_no_wide_edge(
    length_px: float, shape: tuple[int, int], offset_px: tuple[float, float]
) -> None:
    """Motion rounds a corner until it passes for one straight edge, with numbers and without a flag."""

    def ramp(**how: object) -> Tensor:
        edge = closed_edge(*shape, **how)  # type: ignore[arg-type]
        return (edge - edge.min()) / (edge.max() - edge.min())

    upright = ramp(angle_deg=5.0, motion_px=(length_px, 0.0), offset_px=(offset_px[0], 0.0))
    lying = ramp(angle_deg=95.0, offset_px=(0.0, offset_px[1]))
    edge = measured(0.1 + 0.7 * upright * lying + noise(shape, 0.003))
    assert Flag.TWO_EDGES in edge.flags
    assert withheld(edge)
