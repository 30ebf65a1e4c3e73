"""How fast one picture goes through the whole chain."""

from __future__ import annotations

from typing import Any

import torch

from blurnoise.camera import Camera
from blurnoise.simulate import simulate
from blurnoise_eval.bench.timing import limited_threads, quartiles, times_ms
from blurnoise_eval.results import hardware

PAPERS_TOOL_S = 1.0
"""Seconds that the tool of Lin et al. 2024 takes for one 1280x720 picture on a machine of this kind."""


def simulate_speed(threads: int, repeats: int = 21) -> dict[str, Any]:
    """One grey 1280x720 picture, 30 ms, 1000 px/s: median and quartiles of the time in ms."""
    image = torch.rand(1, 1, 720, 1280, generator=torch.Generator().manual_seed(0))
    camera = Camera.preset("imx250")

    def once() -> torch.Tensor:
        moving = (1000.0, 0.0)
        return simulate(
            image, camera, exposure_s=0.03, illuminance_lux=50.0, velocity_px_s=moving, generator=[1]
        )

    with limited_threads(threads):
        times = quartiles(times_ms(once, repeats))
    return {
        "picture": "1x1x720x1280, 30 ms, 1000 px/s",
        "threads": threads,
        "median_ms": times.median,
        "quartiles_ms": f"{times.low:.1f} to {times.high:.1f}",
        "faster_than_papers_tool": 1e3 * PAPERS_TOOL_S / times.median,
        **hardware(),
    }
