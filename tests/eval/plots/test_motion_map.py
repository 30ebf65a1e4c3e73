"""Maps of the longest exposure: against closed forms, place by place; their words, their table, their figure."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.plots import motion_map

from blurnoise.motion.ego import EgoMotion, Vehicle, View

VIEW = View(961, 541, 60.0, "rectilinear")  # f = 832.25 px
SPEED_M_S = 50 / 3.6
MOUNT = Vehicle(1.5)


def maps(mount: Vehicle = MOUNT, yaw_deg_s: float = 0.0, **options: object) -> list[motion_map.ExposureMap]:
    return motion_map.maps_of(VIEW, mount, mount.driving(SPEED_M_S, yaw_deg_s), (10.0,), **options)  # type: ignore[arg-type]


def test_the_road_at_the_bottom_and_no_limit_at_the_horizon() -> None:
    """Straight ahead the flow at (x, y) is f (x y, y^2) V/h, at the bottom largest in the corners."""
    road, plane = maps()
    x, y = 480 / VIEW.focal_px, 270 / VIEW.focal_px
    fastest = VIEW.focal_px * y * math.hypot(x, y) * SPEED_M_S / 1.5
    limits = road.limits_s()
    assert limits["bottom_edge"] == pytest.approx(1 / fastest)
    assert limits["horizon"] == limits["half"] == math.inf  # the sky
    told = road.facts()
    assert told["horizon_ms"] is told["half_ms"] is None
    assert told["all_ms"] == told["bottom_edge_ms"] == pytest.approx(1e3 / fastest)
    corner_px_s = math.hypot(480, 270) * SPEED_M_S / 10  # of the plane, above the road
    assert plane.limits_s() == {
        "all": pytest.approx(1 / corner_px_s),
        "half": pytest.approx(plane.at_share_s(0.5)),
    }


def test_yaw_alone_limits_the_sky() -> None:
    """f w (1 + x^2) at the horizon's ends, f w in its middle."""
    sky = maps(yaw_deg_s=10.0, blur_px=2.0)[0]
    at_end = VIEW.focal_px * math.radians(10) * (1 + (480 / VIEW.focal_px) ** 2)
    assert sky.limits_s()["horizon"] == pytest.approx(2 / at_end, rel=1e-5)


def test_pitched_below_the_horizon_there_is_none() -> None:
    found = maps(Vehicle(1.5, pitch_deg=40.0))[0]
    assert "horizon" not in found.limits_s()
    assert "horizon" not in found.sentence(1.0)
    assert "horizon_ms" not in found.facts()


def test_shares() -> None:
    """Half of the plane at 10 m is within the median of its pixels; the scene behind it is not counted."""
    _, plane = maps(yaw_deg_s=10.0)
    own = np.isclose(plane.range_m, 10 / VIEW.rays(plane.pixels)[2])
    assert (own == plane.own).all()
    assert 0.4 < own.mean() < 0.9
    assert plane.at_share_s(0.5) == pytest.approx(np.median(plane.longest_s[own]), rel=1e-3)
    assert plane.share(plane.at_share_s(0.3)) == pytest.approx(0.3, abs=1e-4)
    assert plane.share(0.0) == 1.0


def test_values_are_coarser_or_all_of_the_same_map(tmp_path: Path) -> None:
    small = View(60, 40, 60.0)
    motion = MOUNT.driving(SPEED_M_S, 10.0)
    table, dense = tmp_path / "a.csv", tmp_path / "a.npy"
    for path in (table, dense):
        motion_map.write_values(path, small, MOUNT, motion, (10.0,), 1.0)
    longest_ms = np.load(dense)
    assert longest_ms.shape == (2, 40, 60)
    assert longest_ms.dtype == np.float32
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == motion_map.COLUMNS
    assert len(rows) == 2 * 33 * 33
    for row in (rows[33 * 32 + 32], rows[-1], rows[33 * 33]):
        x, y = float(row["x_px"]), float(row["y_px"])
        expected = longest_ms[int(row["scene"] != motion_map.ROAD), int(y), int(x)]
        assert float(row["longest_exposure_ms"]) == pytest.approx(expected, rel=1e-5)
        flow = math.hypot(float(row["flow_x_px_s"]), float(row["flow_y_px_s"]))
        assert 1e3 / flow == pytest.approx(expected, rel=1e-5)
    assert rows[0]["range_m"] == ""  # the sky
    with pytest.raises(ValueError, match=r"values = .*must end in \.csv or \.npy"):
        motion_map.write_values(tmp_path / "a.txt", small, MOUNT, motion, (), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        (VIEW, MOUNT, MOUNT.driving(SPEED_M_S, 10.0), (10.0,)),
        (VIEW, MOUNT, EgoMotion(), ()),  # nothing moves
        (View(321, 200, 300.0), Vehicle(1.0, 90.0), Vehicle(1.0, 90.0).driving(1.0), (1.0, 2.0, 3.0)),  # no sky
        (View(3, 2, 60.0), MOUNT, MOUNT.driving(SPEED_M_S), (1e-3,)),
        (View(2, 2, 60.0), MOUNT, MOUNT.driving(SPEED_M_S), ()),
    ],
)  # fmt: skip
def test_a_figure_of_whatever_is_seen(case: tuple[View, Vehicle, EgoMotion, tuple[float, ...]]) -> None:
    view, mount, motion, planes_m = case
    found = motion_map.maps_of(view, mount, motion, planes_m, most=40)
    figure = motion_map.draw(found, view, 1.0, "A camera")
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[: len(found)] == [each.scene for each in found]
    figure.savefig(io.BytesIO(), dpi=30)
    assert all(each.sentence(1.0, 0.01) for each in found)


def test_contours_are_where_the_map_says() -> None:
    """The line of 1 ms on the plane at 10 m, a circle around the focus of expansion: r = 10 m x 1 px/(V 1 ms)."""
    found = maps()
    figure = motion_map.draw(found, VIEW, 1.0, "")
    lines = figure.axes[1].collections[1]
    place = list(lines.levels).index(2.0)  # type: ignore[attr-defined]
    vertices = np.concatenate(list(lines.get_paths()[place].to_polygons(closed_only=False)))
    above = vertices[vertices[:, 1] < 270]
    radius = np.hypot(above[:, 0] - 480, above[:, 1] - 270)
    assert radius == pytest.approx(10 / (SPEED_M_S * 0.002), rel=0.01)
