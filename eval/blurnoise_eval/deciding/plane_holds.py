"""Whether the plane of lux-seconds and pixels holds for a camera, and what breaks it.

On the plane conditions with the same light on the sensor and the same motion during the exposure are one experiment.
So nothing that a picture shows may go with the exposure time in another way: dark charge does, and so would a
shutter that rolls. What the error budget of :mod:`blurnoise.scene.plan` leaves out does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from blurnoise.light.conditions import Conditions
from blurnoise.optics.camera import Camera
from blurnoise.scene.plan import Contribution, plan_at
from blurnoise.sensor.stages import DARK_CURRENT
from blurnoise_eval.deciding.nodes import Line, by_direction
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec


def what_breaks(
    camera: Camera,
    exposures_s: tuple[float, float],
    lines: Sequence[Line],
    temperature_c: float = 25.0,
    trajectory: TrajectorySpec | None = None,
    drives: bool = False,
) -> list[str]:
    """Why the plane does not hold between two exposures, a reason each; empty where it holds.

    drives: whether the camera does. Asked at gain 0 dB: gain raises the dark charge and the noise that hides it
    alike. Raises ``ValueError`` for a camera of several captures.
    """
    longest_s = max(exposures_s)
    reasons = [
        f"{name} goes with the exposure time alone ({dn:.2g} DN in {1e3 * longest_s:g} ms at {temperature_c:g} °C)"
        for name, dn in _of_time_alone(camera, min(exposures_s), longest_s, temperature_c).items()
    ]
    if len(planes := by_direction(lines)) > 1:
        reasons.append(f"motion has {len(planes)} directions, and blurs differently in each")
    if trajectory is not None:
        reasons.append(f"along {trajectory.text} another exposure sees another part of the path")
    if drives:
        reasons.append(
            "before a camera that drives each place has a blur of its own, in any exposure another"
        )
    return reasons


def _of_time_alone(
    camera: Camera, shortest_s: float, longest_s: float, temperature_c: float
) -> dict[str, float]:
    """DN RMS of what the budget keeps at the longest exposure, and would not be the same at the shortest."""

    def budget(of: Camera, exposure_s: float, white_e: float) -> tuple[Contribution, ...]:
        at = Conditions(of, exposure_s, temperature_c, white_e, (1.0, 0.0))
        return plan_at(at).stages

    in_the_dark = budget(camera, longest_s, 0.0)
    found = {each.name: each for each in in_the_dark if each.name == DARK_CURRENT.name}
    cold, bright_e = replace(camera, dark_current_e_s=0.0), camera.full_well_e
    both = zip(budget(cold, shortest_s, bright_e), budget(cold, longest_s, bright_e), strict=True)
    found |= {long.name: long for short, long in both if long.contribution_dn != short.contribution_dn}
    return {name: each.contribution_dn for name, each in found.items() if each.kept}
