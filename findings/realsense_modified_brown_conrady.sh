#!/usr/bin/env bash
# pyrealsense2 2.59.1.11053: two functions of one lens model are no inverses, and no error says so.
# Expected: rs2_project_point_to_pixel(rs2_deproject_pixel_to_point(pixel)) is the pixel, for every model that both accept.
# Seen: so for brown_conrady, inverse_brown_conrady and kannala_brandt4 (below .001 px); with modified_brown_conrady and
# k1 = .1 the pixel (10, 10) comes back as (-2.8, 0.5): deprojecting leaves the coefficients out, projecting uses them.
# Hurt: who goes from boxes to points and back, or to another camera.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pyrealsense2==2.59.1.11053 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import pyrealsense2 as rs


def there_and_back(model):
    lens = rs.intrinsics()
    lens.width, lens.height, lens.ppx, lens.ppy, lens.fx, lens.fy = 640, 480, 320.0, 240.0, 600.0, 600.0
    lens.model, lens.coeffs = model, [0.1, 0.0, 0.0, 0.0, 0.0]
    point = rs.rs2_deproject_pixel_to_point(lens, [10.0, 10.0], 2.0)
    return rs.rs2_project_point_to_pixel(lens, point), point


for model in (rs.distortion.brown_conrady, rs.distortion.inverse_brown_conrady, rs.distortion.kannala_brandt4):
    (x, y), _ = there_and_back(model)
    print(model, round(x, 3), round(y, 3))
    assert abs(x - 10) < 1e-3 and abs(y - 10) < 1e-3
(x, y), point = there_and_back(rs.distortion.modified_brown_conrady)
print("modified_brown_conrady", round(x, 3), round(y, 3), "by way of", point)
assert abs(x + 2.83) < 0.01 and abs(y - 0.48) < 0.01
assert abs(point[0] - 2 * (10 - 320) / 600) < 1e-6  # a pinhole's
PY
