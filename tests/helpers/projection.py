"""Where a view's lens images points: by the formula of each lens, to check rays and flow by."""

import numpy as np


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
