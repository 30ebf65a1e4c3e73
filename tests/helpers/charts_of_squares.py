"""Dark squares on a bright ground, all tilted alike, and the closed form of their edges' MTF50."""

import math

import numpy as np
import torch

DARK, BRIGHT, TILT_DEG, SIDE_PX = 0.1, 0.8, 5.0, 90
HEIGHT_PX, WIDTH_PX = 320, 400
CENTRES_PX = [(100.0, 85.0), (290.0, 88.0), (110.0, 240.0), (295.0, 235.0)]


def squares():
    """(1, 1, HEIGHT_PX, WIDTH_PX) linear; pixels are exact areas, but for those at the corners."""
    cos, sin = math.cos(math.radians(TILT_DEG)), math.sin(math.radians(TILT_DEG))
    x = torch.arange(WIDTH_PX, dtype=torch.float64) + 0.5
    y = torch.arange(HEIGHT_PX, dtype=torch.float64)[:, None] + 0.5

    def share(distance):
        """Of a pixel at this distance within a straight edge: a step through the pixel's two sides' boxes."""
        ends = ((1, (cos + sin) / 2), (-1, (cos - sin) / 2), (-1, (sin - cos) / 2), (1, -(cos + sin) / 2))
        return sum(sign * (distance + end).clamp(min=0) ** 2 for sign, end in ends) / (2 * cos * sin)

    inside = torch.zeros(HEIGHT_PX, WIDTH_PX, dtype=torch.float64)
    for centre_x, centre_y in CENTRES_PX:
        u, v = (x - centre_x) * cos - (y - centre_y) * sin, (x - centre_x) * sin + (y - centre_y) * cos
        half = SIDE_PX / 2
        inside += share(half - u) * share(half + u) * share(half - v) * share(half + v)
    return (BRIGHT + (DARK - BRIGHT) * inside)[None, None]


def corners():
    """x, y of every corner, px."""
    cos, sin = math.cos(math.radians(TILT_DEG)), math.sin(math.radians(TILT_DEG))
    half = SIDE_PX / 2
    return [
        (x + u * cos + v * sin, y - u * sin + v * cos)
        for x, y in CENTRES_PX
        for u in (-half, half)
        for v in (-half, half)
    ]


def mtf50(angle_deg, motion_x_px=0.0):
    """Of the pixel and the motion, cycles/px along the normal of an edge at ``angle_deg``."""
    cos, sin = abs(math.cos(math.radians(angle_deg))), abs(math.sin(math.radians(angle_deg)))
    frequency = np.linspace(0, 1, 200_001)
    response = np.sinc(cos * frequency) * np.sinc(sin * frequency) * np.sinc(motion_x_px * cos * frequency)
    return float(frequency[(response < 0.5).argmax()])
