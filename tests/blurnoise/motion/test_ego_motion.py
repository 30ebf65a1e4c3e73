"""Road speed to pixels, ego-motion and vehicles: finite differences, figures worked out by hand, OpenCV."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from blurnoise import Camera, blur_pixels
from blurnoise.camera import lens as lenses
from blurnoise.motion.ego import EgoMotion, Lens, Vehicle, View, range_of_depth_m

HD = View(1920, 1080, 60.0, "rectilinear")  # f = 1662.77 px
LENSES: tuple[Lens, ...] = ("rectilinear", "f-theta")
EVERY_WAY = EgoMotion((1.3, -0.7, 9.0), (4.0, -11.0, 6.0))
CAMERA = Camera.preset("imx250")
SIZE = (47, 61)
WIDE = {"width_px": 4096, "hfov_deg": 99.32}
# Nine results as the paper prints them. Object widths, distances and exposures are reconstructed from the
# results (only speed x exposure and width / distance enter); km/h are divided by 3.6 unrounded.
TABLE_2 = [
    (0.5, 25, 5, 30, 3.93804),
    (0.5, 50, 5, 30, 1.96907),
    (0.5, 100, 5, 30, 0.98454),
    (0.5, 100, 10, 30, 1.96908),
    (4.9, 100, 20, 30, 3.93738),
    (4.9, 100, 50, 30, 9.84346),
    (4.9, 50, 100, 15, 19.67512),
    (4.9, 50, 100, 30, 39.35024),
    (4.9, 100, 100, 30, 19.68692),
]


@pytest.mark.parametrize(("width_m", "distance_m", "speed_kmh", "exposure_ms", "blur_px"), TABLE_2)
def test_table_2(width_m, distance_m, speed_kmh, exposure_ms, blur_px):
    found = blur_pixels(speed_kmh / 3.6, distance_m, exposure_ms / 1e3, target_width_m=width_m, **WIDE)
    assert found == pytest.approx(blur_px, abs=1e-4)


def test_rectilinear_is_26_percent_smaller_on_axis():
    """f = 1739.3 px, blur f v T / d."""
    found = blur_pixels(100 / 3.6, 50, 0.03, target_width_m=4.9, lens="rectilinear", **WIDE)
    assert found == pytest.approx(1739.3 * (100 / 3.6) * 0.03 / 50, rel=1e-4)
    assert found / 39.35024 == pytest.approx(0.737, abs=0.002)


def projected(view, points_m):
    """Pixels (2, ...) at which points (3, ...) are seen; for a pinhole NaN behind the camera."""
    x, y, z = points_m
    if view.calibrated is not None or view.lens == "rectilinear":
        with np.errstate(divide="ignore"):
            scale = np.where(z > 0, 1 / z, np.nan)
        if view.calibrated is not None:
            return view.calibrated.imaged(points_m[:2] * scale, (view.height_px, view.width_px))
    else:
        across = np.hypot(x, y)
        scale = np.where(across > 0, np.arctan2(across, z) / np.where(across > 0, across, 1), 1 / np.abs(z))
    middle = np.array([(view.width_px - 1) / 2, (view.height_px - 1) / 2])
    return np.asarray(view.focal_px * scale * points_m[:2] + middle.reshape(2, *[1] * x.ndim))


def at(*pixels):
    return np.array(pixels, dtype=np.float64).T


def below_axis(view, *rows_px):
    return at(*(((view.width_px - 1) / 2, (view.height_px - 1) / 2 + row) for row in rows_px))


def moved(points_m, motion, time_s):
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
def test_flow_is_the_slope_of_the_projection(lens, hfov_deg):
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


def test_road_below_the_horizon_and_sky_above():
    """2 degrees down: the horizon is f tan(2 degrees) = 58.07 px above the middle; the road there is far away."""
    mount = Vehicle(1.5, pitch_deg=2.0)
    above, below = mount.road_m(HD.rays(below_axis(HD, -58.2, -57.9)))
    assert above == np.inf
    assert below > 1.5 * HD.focal_px / 0.4
    looking_at = mount.road_m(HD.rays(below_axis(HD, 0.0)))
    assert looking_at == pytest.approx(1.5 / math.sin(math.radians(2)))
    assert np.isinf(range_of_depth_m(View(99, 9, 300.0).rays(at((0, 4))), 5.0)).all()


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("mount", [Vehicle(1.4), Vehicle(2.0, 12.0, 25.0)])
def test_the_rectified_road_moves_evenly(lens, mount):
    """Wherever the camera looks, every place on the road comes along the way at the vehicle's speed."""
    view, speed = View(641, 481, 70.0, lens), 20.0

    def places_m(at_px):
        rays = view.rays(at_px)
        return np.asarray(rays * mount.road_m(rays))

    pixels = view.pixels(13).reshape(2, -1)
    pixels = pixels[:, np.isfinite(mount.road_m(view.rays(pixels)))]
    pixels = pixels[
        :, np.linalg.norm(places_m(pixels), axis=0) < 60
    ]  # beyond, a place is no pixel's any more
    flow = view.flow_px_s(pixels, mount.road_m(view.rays(pixels)), mount.driving(speed))
    moved = (places_m(pixels + 1e-5 * flow) - places_m(pixels - 1e-5 * flow)) / 2e-5
    assert pixels.shape[1] > 50
    np.testing.assert_allclose(
        moved, np.outer(-speed * mount.ahead, np.ones(len(flow[0]))), atol=1e-4 * speed
    )


@pytest.mark.parametrize("plane_m", [None, 8.0])
def test_places_are_those_of_the_whole_flow(plane_m):
    vehicle = Vehicle(pitch_deg=2.0, heading_deg=-4.0, plane_m=plane_m, yaw_deg_s=5.0, pitch_deg_s=-3.0)
    whole = vehicle.flow_px_s(CAMERA, SIZE, 13.0).numpy()
    places = np.array([[3.0, 60.0, 31.0], [40.0, 46.0, 2.0]])
    own = vehicle.flow_at(places, CAMERA, SIZE, 13.0)
    np.testing.assert_allclose(own, whole[:, [40, 46, 2], [3, 60, 31]], rtol=1e-5, atol=1e-5)
    slower = replace(vehicle, pitch_deg_s=0.0).flow_at(places, CAMERA, SIZE, 13.0)
    assert np.abs(own - slower)[1].min() > 1


@pytest.mark.parametrize("scale", [1, 2])
def test_a_calibrated_camera_drives_with_its_own_lens(scale):
    """The road by OpenCV: a pixel's point, seen again from where the camera is a moment later and earlier."""
    coefficients, focal_px, centre_px = (-0.2, 0.04, 0.001, -0.0005, 0.002), (400.0, 410.0), (330.0, 235.0)
    distortion = lenses.Distortion("opencv", coefficients, focal_px, centre_px)
    camera = CAMERA.with_figures(width_px=640, height_px=480, distortion=distortion)
    matrix = np.array([[focal_px[0], 0, centre_px[0]], [0, focal_px[1], centre_px[1]], [0, 0, 1]])
    pixels = np.array([[20.0, 610.0, 333.0], [460.0, 300.0, 236.5]])
    rays = cv2.undistortPoints(pixels.T[:, None], matrix, np.array(coefficients), None, None, None,
                               (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12))[:, 0]  # fmt: skip
    road = np.column_stack([rays, np.ones(3)]) * (1.5 / rays[:, 1:])
    step_s = 1e-4
    seen = [
        cv2.projectPoints(road - [0, 0, ahead_m], np.zeros(3), np.zeros(3), matrix, np.array(coefficients))[0]
        for ahead_m in (20 * step_s, -20 * step_s)
    ]
    expected = (seen[0] - seen[1])[:, 0].T / (2 * step_s) / scale
    size = (480 // scale, 640 // scale)
    own = Vehicle().flow_at((pixels + 0.5) / scale - 0.5, camera, size, 20.0)
    np.testing.assert_allclose(own, expected, rtol=1e-5, atol=1e-4)
    assert np.abs(Vehicle(lens="rectilinear").flow_at(pixels, camera, (480, 640), 20.0) - own).max() > 20


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Vehicle(0.0), "height_m = 0.0: must be finite and > 0"),
        (lambda: Vehicle(1.0, pitch_deg=91), "pitch_deg = 91"),
        (lambda: Vehicle(plane_m=-1.0), "plane_m"),
        (lambda: Vehicle(lens="fish"), "lens"),
        (lambda: Vehicle(1.0).driving(-1), "speed_m_s = -1"),
        (lambda: View(0, 10, 60), "width_px"),
        (lambda: View(10, 10, 180, "rectilinear"), "hfov_deg = 180.0: must be < 180"),
        (lambda: range_of_depth_m(np.ones((3, 2)), -1.0), "depth_m: the smallest is -1; must be > 0"),
        (lambda: View(5, 5, 60).flow_px_s(np.zeros((2, 1)), np.zeros(1), EgoMotion()), "range_m: the smallest"),
        (lambda: View(1 << 20, 1 << 20, 60.0).pixels(), "width_px, height_px: 1048576 x 1048576 pixels; at most"),
    ],
)  # fmt: skip
def test_bad_input_is_named(make, named):
    with pytest.raises(ValueError, match=named):
        make()
