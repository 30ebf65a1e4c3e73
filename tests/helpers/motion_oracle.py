"""Every pair of motions by brute force: each pixel's mean over its row's window of what passes it."""

import math
from functools import lru_cache
from itertools import combinations

import cv2
import numpy as np
import torch
from brute_force import photograph

from blurnoise import Camera, Layer, Trajectory
from blurnoise.light import effects
from blurnoise.scene.captures import captures_of_exposure
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene

HEIGHT, WIDTH, EXPOSURE_S, ROW_S = 108, 144, 0.01, 1.5e-4
VELOCITY_PX_S = (700.0, -400.0)
ZOOM_PER_S = 6.0  # of a flow about the picture's middle, which the velocity moves on
PATH = Trajectory.sinusoid(4.0, 70.0, 0.2, direction_deg=30.0, phase_rad=0.7)
OBJECT_PX_S, OBJECT_PLACE = (-800.0, 500.0), (60, 44)
FINE = 8  # values to a pixel's side
INSIDE = (slice(20, -20), slice(22, -22))
MOTIONS = ("straight", "path", "flow", "rolling", "global reset", "objects")


class Combination:
    """Which motions a picture has."""

    def __init__(self, motions):
        self.motions = motions
        lines = motions & {"rolling", "global reset"}
        self.reset = "global reset" in motions
        self.path = PATH if "path" in motions else None
        self.row_s = ROW_S if lines else 0.0
        moves = "straight" in motions or motions == lines  # before rows alone something has to move
        self.velocity_px_s = VELOCITY_PX_S if moves else (0.0, 0.0)

    @property
    def windows_s(self):
        """When each row's exposure begins and ends."""
        tau = (np.arange(HEIGHT) - (HEIGHT - 1) / 2) * self.row_s
        if not self.reset:
            return tau - EXPOSURE_S / 2, tau + EXPOSURE_S / 2
        start = np.full(HEIGHT, -(EXPOSURE_S + tau[-1]) / 2)
        return start, start + EXPOSURE_S + np.arange(HEIGHT) * self.row_s

    def flow(self):
        """Velocities (2, H, W), px/s."""
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        offsets = np.stack([x - (WIDTH - 1) / 2, y - (HEIGHT - 1) / 2])
        return torch.from_numpy(ZOOM_PER_S * offsets + np.reshape(self.velocity_px_s, (2, 1, 1)))


STREET, THING = photograph(HEIGHT, WIDTH, 5, 3)[0], photograph(20, 24, 9, 3)[0]


def layer(kind=torch.float64):
    """A textured disc whose edge is 4 px wide."""
    y, x = np.mgrid[:20, :24]
    alpha = ((1 - np.hypot((y - 9.5) / 9.5, (x - 11.5) / 11.5)) * 3).clip(0, 1)
    return Layer(
        torch.from_numpy(THING).to(kind), torch.from_numpy(alpha).to(kind), OBJECT_PX_S, OBJECT_PLACE
    )


def _finer(planes):
    """Planes (C, H, W) that wrap round at ``FINE`` times their samples, (H, W, C), by their spectra."""
    channels, height, width = planes.shape
    spectrum = np.zeros((channels, FINE * height, FINE * width), complex)
    for rows in (slice(0, height // 2), slice(-(height // 2), None)):
        for columns in (slice(0, width // 2), slice(-(width // 2), None)):
            spectrum[:, rows, columns] = np.fft.fft2(planes)[:, rows, columns]
    seen = np.fft.ifft2(spectrum).real * FINE**2
    return np.ascontiguousarray(np.moveaxis(seen, 0, -1), np.float32)


@lru_cache(maxsize=1)
def _sheets():
    own, sheet, (left, top) = layer(), np.zeros((4, HEIGHT, WIDTH)), OBJECT_PLACE
    planes = torch.cat([own.light * own.alpha, own.alpha[None]]).numpy()
    sheet[:, top : top + 20, left : left + 24] = planes
    return _finer(STREET), _finer(sheet)


def _at(sheet, x, y):
    places = (np.broadcast_to(FINE * along, (HEIGHT, WIDTH)).astype(np.float32) for along in (x, y))
    return np.asarray(cv2.remap(sheet, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP), float)


def truth(of, moments=256):
    """The mean (3, H, W) of each row's window, and as much brighter as that is longer."""
    street, thing = _sheets()
    starts, stops = of.windows_s
    columns, rows = np.arange(WIDTH)[None], np.arange(HEIGHT)[:, None]
    total = np.zeros((HEIGHT, WIDTH, 3))
    for moment in range(moments):
        now = (starts + (stops - starts) * (moment + 0.5) / moments)[:, None]
        x, y = columns + 0.0 * now, rows + 0.0 * now
        if of.path is not None:
            origin = of.path.origin_px(EXPOSURE_S)
            x = x - np.interp(now, of.path.time_s, of.path.x_px) + origin[0]
            y = y - np.interp(now, of.path.time_s, of.path.y_px) + origin[1]
        beside = x - OBJECT_PX_S[0] * now, y - OBJECT_PX_S[1] * now
        if "flow" in of.motions:  # where it came from, x' = zoom (x - middle) + v
            grown = np.exp(-ZOOM_PER_S * now)
            (vx, vy), middle = of.velocity_px_s, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
            x = (x - middle[0] + vx / ZOOM_PER_S) * grown - vx / ZOOM_PER_S + middle[0]
            y = (y - middle[1] + vy / ZOOM_PER_S) * grown - vy / ZOOM_PER_S + middle[1]
        else:
            x, y = x - of.velocity_px_s[0] * now, y - of.velocity_px_s[1] * now
        seen = _at(street, x, y)
        if "objects" in of.motions:
            own = _at(thing, *beside)
            seen = own[..., :3] + (1 - own[..., 3:].clip(0, 1)) * seen
        total += seen
    brighter = ((stops - starts) / EXPOSURE_S)[:, None, None]
    return np.moveaxis(total / moments * brighter, -1, 0)


def exposed(of, light, flow=None):
    """What the light effects make of a picture (1, 3, H, W)."""
    camera = Camera.preset("imx250")
    if of.row_s:
        row_s = of.row_s * camera.field.per_sensor_px((HEIGHT, WIDTH))
        camera = camera.with_figures(row_time_s=row_s, shutter="global-reset" if of.reset else "rolling")
    by_pixel = of.flow() if flow is None else flow
    scene = Scene(light, layers=[layer(light.dtype)] if "objects" in of.motions else ())
    velocity = by_pixel if "flow" in of.motions else of.velocity_px_s
    exposure = Exposure(camera, EXPOSURE_S, 100.0, velocity, trajectory=of.path, seed=[0])
    ((at, _),) = captures_of_exposure(scene, exposure, 1)
    return effects.through(light, at, border="circular")


def found(of, kind=torch.float64):
    """The same of the street."""
    return exposed(of, torch.from_numpy(STREET)[None].to(kind))[0].double().numpy()


def combinations_of(most):
    """All of up to ``most`` motions that one frame may have."""
    every = [frozenset(some) for count in range(1, most + 1) for some in combinations(MOTIONS, count)]
    return [Combination(some) for some in every if not {"rolling", "global reset"} <= some]


def error_dn(one, other):
    """RMS, 8-bit numbers of linear light, away from the border."""
    return float(255 * math.sqrt(((one - other)[..., *INSIDE] ** 2).mean()))
