"""Plans of a sweep, briefly."""

from blurnoise_eval.plan.axes import FURTHER
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan

from blurnoise import Camera

IMX250 = Camera.preset("imx250")


def plan(
    exposures_s,
    lights_lux,
    right_px_s=(0.0,),
    down_px_s=(0.0,),
    *,
    repeats=1,
    seed=0,
    examples=True,
    **further,
):
    """The plan over the four axes that every condition states, and ``further`` ones by name."""
    core = {"exposure_s": exposures_s, "illuminance_lux": lights_lux}
    core |= {"velocity_x_px_s": right_px_s, "velocity_y_px_s": down_px_s}
    return SweepPlan(core | further, repeats=repeats, seed=seed, examples=examples)


_OF_CAMERA = Conditions(exposure_s=1.0, illuminance_lux=1.0).on(IMX250)
OWN = {name: _OF_CAMERA[name] for name in FURTHER}
"""Further axes where the camera imx250 has them, as columns of a row."""
