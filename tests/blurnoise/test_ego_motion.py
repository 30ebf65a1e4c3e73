"""Ego-motion: flow against finite differences of the projection, figures worked out by hand, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from projection import projected

from blurnoise.motion.ego import EgoMotion, Floats, Lens, Vehicle, View, range_of_depth_m

HD = View(1920, 1080, 60.0, "rectilinear")  # f = 1662.77 px
FAST_M_S = 100 / 3.6
LENSES: tuple[Lens, ...] = ("rectilinear", "f-theta")
EVERY_WAY = EgoMotion((1.3, -0.7, 9.0), (4.0, -11.0, 6.0))


def at(*pixels: tuple[float, float]) -> Floats:
    return np.array(pixels, dtype=np.float64).T


def below_axis(view: View, *rows_px: float) -> Floats:
    return at(*(((view.width_px - 1) / 2, (view.height_px - 1) / 2 + row) for row in rows_px))


def moved(points_m: Floats, motion: EgoMotion, time_s: float) -> Floats:
    """Points fixed in the world, seen by the camera a short time later: P' = -V - w x P, by a small rotation."""
    turn = np.radians(motion.rotation_deg_s) * time_s
    ahead = points_m - (np.array(motion.velocity_m_s) * time_s)[:, None]
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    cosine, sine = math.cos(-angle), math.sin(-angle)  # Rodrigues
    turned = ahead * cosine + np.cross(axis, ahead.T).T * sine
    return np.asarray(turned + np.outer(axis, axis @ ahead) * (1 - cosine))


@pytest.mark.parametrize(
    ("lens", "hfov_deg"), [("rectilinear", 60), ("f-theta", 60), ("f-theta", 190), ("f-theta", 300)]
)
def test_flow_is_the_slope_of_the_projection(lens: Lens, hfov_deg: float) -> None:
    """Central differences over 2e-5 s: their error is that of the third derivative, below 1e-6 of the flow."""
    view = View(641, 479, hfov_deg, lens)
    pixels = view.pixels(9).reshape(2, -1)
    rays = view.rays(pixels)
    seen = np.isfinite(rays[0])
    pixels, rays = pixels[:, seen], rays[:, seen]
    range_m = np.random.default_rng(1).uniform(3.0, 80.0, rays.shape[1])
    range_m[::5] = np.inf
    points = rays * np.where(np.isfinite(range_m), range_m, 1e12)
    step = 1e-5
    later, before = (projected(view, moved(points, EVERY_WAY, sign * step)) for sign in (1, -1))
    slope = (later - before) / (2 * step)
    flow = view.flow_px_s(pixels, range_m, EVERY_WAY)
    assert np.abs(flow - slope).max() < 1e-5 * np.abs(flow).max()
    assert seen.sum() > 40


@pytest.mark.parametrize("lens", LENSES)
def test_rays_and_projection_are_inverse(lens: Lens) -> None:
    view = View(33, 21, 100.0, lens)
    pixels = view.pixels()
    assert projected(view, 7.0 * view.rays(pixels)) == pytest.approx(pixels, abs=1e-9)
    assert np.linalg.norm(view.rays(pixels), axis=0) == pytest.approx(1.0)


def test_lenses_agree_on_the_axis_alone() -> None:
    pinhole, fisheye = View(1001, 801, 90.0, "rectilinear"), View(1001, 801, 90.0, "f-theta")
    for where, alike in ((at((500, 400)), True), (at((950, 400)), False)):
        flows = [
            view.flow_px_s(where, np.array([12.0]), EVERY_WAY) / view.focal_px for view in (pinhole, fisheye)
        ]
        assert np.allclose(*flows, rtol=1e-9) == alike


@pytest.mark.parametrize(
    ("distance_m", "blur_px"), [(46.6, 0.30), (23.3, 1.19), (11.6, 4.77), (7.8, 10.7), (4.3, 34.8)]
)
def test_road_at_100_km_h(distance_m: float, blur_px: float) -> None:
    """1.4 m above it, 10 ms: y^2 V/h with y = h/Z; rows of whole px lie at the distances, hence their rounding."""
    mount = Vehicle(1.4)
    row = round(HD.focal_px * 1.4 / distance_m / 10) * 10
    pixels = below_axis(HD, row)
    range_m = mount.road_m(HD.rays(pixels))
    assert HD.rays(pixels)[2] * range_m == pytest.approx(distance_m, rel=8e-3)
    across, down = HD.flow_px_s(pixels, range_m, mount.driving(FAST_M_S))[:, 0] * 0.01
    assert across == pytest.approx(0, abs=1e-12)
    assert down == pytest.approx(blur_px, rel=6e-3)


@pytest.mark.parametrize(("depth_m", "blur_px"), [(20, 6.9), (50, 2.8), (100, 1.4)])
def test_frontal_target_off_the_axis(depth_m: float, blur_px: float) -> None:
    pixels = at((959.5 + 500, 539.5), (959.5, 539.5))
    range_m = range_of_depth_m(HD.rays(pixels), depth_m)
    flow = HD.flow_px_s(pixels, range_m, EgoMotion((0, 0, FAST_M_S))) * 0.01
    assert flow[0, 0] == pytest.approx(blur_px, rel=0.01)
    assert flow[1, 0] == 0
    assert flow[:, 1] == pytest.approx(0)  # the focus of expansion


def test_rotation() -> None:
    """0.290 px per degree/s and 10 ms on the axis; 1.33 times that at the side, pitching 1.11 at the lower edge."""
    pixels = at((959.5, 539.5), (0, 539.5), (959.5, 1079))
    sky = np.full(3, np.inf)
    yaw = HD.flow_px_s(pixels, sky, EgoMotion(rotation_deg_s=(0, 1, 0))) * 0.01
    pitch = HD.flow_px_s(pixels, sky, EgoMotion(rotation_deg_s=(1, 0, 0))) * 0.01
    assert yaw[0, 0] == pytest.approx(-0.290, abs=5e-4)  # turning right moves everything to the left
    assert yaw[0, 1] / yaw[0, 0] == pytest.approx(1.33, abs=5e-3)
    assert pitch[1, 2] / pitch[1, 0] == pytest.approx(1.11, abs=6e-3)
    corner_deg_s = math.degrees(3 / (50 / 3.6))
    assert corner_deg_s == pytest.approx(12.4, abs=0.05)
    assert -yaw[0, 0] * corner_deg_s == pytest.approx(3.6, abs=0.02)


@pytest.mark.parametrize("lens", LENSES)
def test_rotation_knows_no_distance_and_translation_its_inverse(lens: Lens) -> None:
    view = View(65, 49, 80.0, lens)
    pixels, turn = view.pixels(), EgoMotion(rotation_deg_s=(3, -5, 2))
    near, far = (np.full((49, 65), range_m) for range_m in (2.0, 40.0))
    assert view.flow_px_s(pixels, near, turn) == pytest.approx(view.flow_px_s(pixels, far, turn))
    drive = EgoMotion((0.5, 0.2, 10))
    assert view.flow_px_s(pixels, near, drive) == pytest.approx(20 * view.flow_px_s(pixels, far, drive))
    assert not view.flow_px_s(pixels, near, EgoMotion()).any()


@pytest.mark.parametrize("lens", LENSES)
def test_rolling_moves_along_rings(lens: Lens) -> None:
    view = View(65, 49, 80.0, lens)
    pixels = view.pixels()
    flow = view.flow_px_s(pixels, np.full((49, 65), np.inf), EgoMotion(rotation_deg_s=(0, 0, 10)))
    radius = pixels - np.array([32.0, 24.0])[:, None, None]
    assert (flow * radius).sum(0) == pytest.approx(0, abs=1e-9)
    assert np.hypot(*flow) == pytest.approx(np.hypot(*radius) * math.radians(10))


def test_a_range_is_no_depth() -> None:
    """At the side of a wide picture a frontal plane is farther than its depth: taking one for the other tells."""
    view = View(1001, 801, 120.0, "f-theta")
    pixels = at((900, 400))
    drive = EgoMotion((0, 0, 10))
    right = view.flow_px_s(pixels, range_of_depth_m(view.rays(pixels), 10.0), drive)
    wrong = view.flow_px_s(pixels, np.array([10.0]), drive)
    assert wrong[0, 0] / right[0, 0] == pytest.approx(1 / math.cos(math.radians(400 * 120 / 1001)))


def test_road_below_the_horizon_and_sky_above() -> None:
    """2 degrees down: the horizon is f tan(2 degrees) = 58.07 px above the middle; the road there is far away."""
    mount = Vehicle(1.5, pitch_deg=2.0)
    above, below = mount.road_m(HD.rays(below_axis(HD, -58.2, -57.9)))
    assert above == np.inf
    assert below > 1.5 * HD.focal_px / 0.4
    looking_at = mount.road_m(HD.rays(below_axis(HD, 0.0)))
    assert looking_at == pytest.approx(1.5 / math.sin(math.radians(2)))
    assert np.isinf(range_of_depth_m(View(99, 9, 300.0).rays(at((0, 4))), 5.0)).all()


def test_mounts() -> None:
    """What is far ahead of the vehicle does not move, wherever the camera looks; a yaw moves the horizon level."""
    for heading_deg, pitch_deg in ((0, 0), (0, 10), (25, 5), (-20, -8)):
        mount = Vehicle(1.5, pitch_deg, heading_deg)
        focus = projected(HD, 100 * mount.ahead[:, None])
        assert HD.flow_px_s(focus, np.array([30.0]), mount.driving(20)) == pytest.approx(0, abs=1e-9)
        assert mount.ahead @ mount.down == pytest.approx(0, abs=1e-15)
    right = Vehicle(1.5, heading_deg=90).driving(10)
    assert right.velocity_m_s == pytest.approx((-10, 0, 0))
    yaw = Vehicle(1.5, pitch_deg=4).driving(0, 10).rotation_deg_s
    assert yaw == pytest.approx((0, 10 * math.cos(math.radians(4)), 10 * math.sin(math.radians(4))))


@pytest.mark.parametrize("lens", LENSES)
def test_the_longest_exposure_makes_that_blur(lens: Lens) -> None:
    """By moving the points themselves, half the exposure before and after: over 1 px paths are straight and even.

    Exposures beyond 30 ms, near the focus of expansion, are left out: there the flow changes within a pixel.
    """
    view, mount = View(1920, 1080, 60.0, lens), Vehicle(1.5, 2.0)
    motion = mount.driving(50 / 3.6, 10)
    pixels = view.pixels(12).reshape(2, -1)
    rays = view.rays(pixels)
    range_m = np.minimum(mount.road_m(rays), range_of_depth_m(rays, 25.0))
    longest_s = 1.0 / np.hypot(*view.flow_px_s(pixels, range_m, motion))
    made_px = []
    for time_s, away, ray in zip(longest_s, range_m, rays.T, strict=True):
        ends = [projected(view, moved(away * ray[:, None], motion, sign * time_s / 2)) for sign in (1, -1)]
        made_px.append(float(np.hypot(*(ends[0] - ends[1]))[0]))
    short = longest_s < 0.03
    assert short.mean() > 0.9
    assert np.array(made_px)[short] == pytest.approx(1.0, abs=2e-3)


def test_fisheye_sees_nothing_beyond_180_degrees() -> None:
    view = View(101, 101, 300.0)
    corner = at((0, 0), (50, 50))
    motion = Vehicle(1.0).driving(10, 5)
    range_m = Vehicle(1.0).road_m(view.rays(corner))
    assert np.isnan(range_m).tolist() == [True, False]
    assert np.isnan(view.flow_px_s(corner, range_m, motion)).all(0).tolist() == [True, False]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Vehicle(0.0), "height_m = 0.0: must be finite and > 0"),
        (lambda: Vehicle(1.0, pitch_deg=91), "pitch_deg = 91"),
        (lambda: Vehicle(1.0, heading_deg=math.nan), "heading_deg"),
        (lambda: Vehicle(1.0).driving(-1), "speed_m_s = -1"),
        (lambda: Vehicle(1.0).driving(1, math.inf), "yaw_deg_s"),
        (lambda: View(0, 10, 60), "width_px"),
        (lambda: View(10, 0, 60), "height_px"),
        (lambda: View(10, 10, 180, "rectilinear"), "hfov_deg = 180.0: must be < 180"),
        (lambda: View(10, 10, 60, "fisheye"), "lens"),  # type: ignore[arg-type]
        (lambda: range_of_depth_m(np.ones((3, 2)), -1.0), "depth_m: the smallest is -1; must be > 0"),
        (lambda: View(5, 5, 60).flow_px_s(np.zeros((2, 1)), np.zeros(1), EgoMotion()), "range_m: the smallest is 0"),
    ],
)  # fmt: skip
def test_bad_input_is_named(make: object, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        make()  # type: ignore[operator]


def test_views_beyond_what_memory_holds() -> None:
    view = View(1 << 20, 1 << 20, 60.0)
    with pytest.raises(ValueError, match="width_px, height_px: 1048576 x 1048576 pixels; at most"):
        view.pixels()
    assert view.pixels(5).shape == (2, 5, 5)


@pytest.mark.parametrize("lens", LENSES)
def test_the_rectified_road_moves_evenly(lens: Lens) -> None:
    """Wherever the camera looks, every place on the road comes along the way at the vehicle's speed.

    And in closed form, straight ahead and level: y^2 V / (h f) of a pinhole, u = x y V / (h f) beside it, and
    f sin^2(y / f) V / h of f-theta.
    """
    view, speed = View(641, 481, 70.0, lens), 20.0
    for mount in (Vehicle(1.4), Vehicle(2.0, 12.0, 25.0)):
        pixels = view.pixels(13).reshape(2, -1)
        pixels = pixels[:, np.isfinite(mount.road_m(view.rays(pixels)))]

        def places_m(at_px: np.ndarray, mount: Vehicle = mount) -> np.ndarray:
            rays = view.rays(at_px)
            return np.asarray(rays * mount.road_m(rays))

        near = np.linalg.norm(places_m(pixels), axis=0) < 60  # beyond, a road place is not a pixel's any more
        pixels = pixels[:, near]
        flow = view.flow_px_s(pixels, mount.road_m(view.rays(pixels)), mount.driving(speed))
        moved = (places_m(pixels + 1e-5 * flow) - places_m(pixels - 1e-5 * flow)) / 2e-5
        assert pixels.shape[1] > 50
        np.testing.assert_allclose(
            moved, np.outer(-speed * mount.ahead, np.ones(pixels.shape[1])), atol=1e-4 * speed
        )
    x, y = 40.0, np.array([30.0, 80.0, 200.0])
    level = Vehicle(1.4)
    seen = below_axis(view, *y)
    down = view.flow_px_s(seen, level.road_m(view.rays(seen)), level.driving(speed))[1]
    if lens == "f-theta":
        np.testing.assert_allclose(
            down, view.focal_px * np.sin(y / view.focal_px) ** 2 * speed / 1.4, rtol=1e-9
        )
        return
    np.testing.assert_allclose(down, y**2 * speed / (1.4 * view.focal_px), rtol=1e-9)
    beside = seen + np.array([[x], [0.0]])
    across = view.flow_px_s(beside, level.road_m(view.rays(beside)), level.driving(speed))[0]
    np.testing.assert_allclose(across, x * y * speed / (1.4 * view.focal_px), rtol=1e-9)
