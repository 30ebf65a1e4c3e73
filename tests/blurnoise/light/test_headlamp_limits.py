"""The beams against the photometric limits of type approval, cd of one lamp in right-hand traffic.

Passing beam of class C, driving beam of class B: UN Regulation 149, 01 series (ECE/TRANS/WP.29/2022/93), tables 5
and 6 and paragraphs 5.1.3 and 5.1.4. Lower beam LB2V and upper beam UB2, of vehicles with two lamps that are aimed by
eye: 49 CFR 571.108, edition of 1 October 2025, tables XVIII and XIX-a. Both were read in a public transcription of
their tables. Degrees right and up. Lines are sampled.
"""

from itertools import pairwise

import numpy as np
import pytest

from blurnoise.light.headlamps import Headlamps

LOW, HIGH = Headlamps("low"), Headlamps("high")
FAR = 90.0

PASSING = {  # from right_deg, to right_deg, up_deg, least, most
    "BR": (2.5, 2.5, 1, 0, 1750), "BLL": (-20, -8, 0.57, 0, 625), "B50L": (-3.43, -3.43, 0.57, 0, 350),
    "P": (-7, -7, 0, 63, np.inf), "75R": (1.15, 1.15, -0.57, 12100, np.inf),
    "50L": (-3.43, -3.43, -0.86, 5000, 37000),
    "50V": (0, 0, -0.86, 5100, np.inf), "50R": (1.72, 1.72, -0.86, 10100, np.inf),
    "50": (-6.84, 6.84, -0.86, 2540, np.inf), "40LL": (-14, -9, -1.07, 850, np.inf),
    "40L": (-9, -9, -1.07, 2800, np.inf),
    "40R": (9, 9, -1.07, 2800, np.inf), "40RR": (9, 14, -1.07, 850, np.inf), "25V": (0, 0, -1.72, 2500, np.inf),
    "25L": (-16, -9, -1.72, 1180, np.inf), "25": (-9, 9, -1.72, 1700, np.inf), "25R": (9, 16, -1.72, 1180, np.inf),
    "15": (-20, 20, -2.86, 425, np.inf), "10": (-4.5, 2, -4, 500, np.inf),
}  # fmt: skip
LOWER = {
    "4U-8L": (-8, -8, 4, 64, np.inf), "4U-8R": (8, 8, 4, 64, np.inf), "2U-4L": (-4, -4, 2, 135, np.inf),
    "1.5U-1R to 3R": (1, 3, 1.5, 200, np.inf), "1.5U-1R to R": (1, FAR, 1.5, 0, 1400),
    "1U-1.5L to L": (-FAR, -1.5, 1, 0, 700), "0.5U-1.5L to L": (-FAR, -1.5, 0.5, 0, 1000),
    "0.5U-1R to 3R": (1, 3, 0.5, 500, 2700), "H-4L": (-4, -4, 0, 135, np.inf), "H-8L": (-8, -8, 0, 64, np.inf),
    "0.6D-1.3R": (1.3, 1.3, -0.6, 10000, np.inf), "0.86D-V": (0, 0, -0.86, 4500, np.inf),
    "0.86D-3.5L": (-3.5, -3.5, -0.86, 1800, 12000), "1.5D-2R": (2, 2, -1.5, 15000, np.inf),
    "2D-9L": (-9, -9, -2, 1250, np.inf), "2D-9R": (9, 9, -2, 1250, np.inf), "2D-15L": (-15, -15, -2, 1000, np.inf),
    "2D-15R": (15, 15, -2, 1000, np.inf), "4D-4R": (4, 4, -4, 0, 12500), "4D-20L": (-20, -20, -4, 300, np.inf),
    "4D-20R": (20, 20, -4, 300, np.inf),
}  # fmt: skip
UPPER = {
    "2U-V": (0, 0, 2, 1500, np.inf), "1U-3": (-3, 3, 1, 5000, np.inf), "H-V": (0, 0, 0, 40000, 75000),
    "H-3": (-3, 3, 0, 15000, np.inf), "H-6": (-6, 6, 0, 5000, np.inf), "H-9": (-9, 9, 0, 3000, np.inf),
    "H-12": (-12, 12, 0, 1500, np.inf), "1.5D-V": (0, 0, -1.5, 5000, np.inf), "1.5D-9": (-9, 9, -1.5, 2000, np.inf),
    "2.5D-V": (0, 0, -2.5, 2500, np.inf), "2.5D-12": (-12, 12, -2.5, 1000, np.inf), "4D-V": (0, 0, -4, 0, 12000),
}  # fmt: skip
DRIVING = {
    "2U-V": (0, 0, 2, 1700, np.inf), "H-3": (-3, 3, 0, 17500, np.inf), "H-6": (-6, 6, 0, 5000, np.inf),
    "H-12": (-12, 12, 0, 1500, np.inf),
}  # fmt: skip


def failing(lamp, limits, aimed_deg=(0.0, 0.0)):
    """Names of the limits that do not hold at some point of their lines."""
    right_off, up_off = aimed_deg
    found = {
        name: lamp.intensity_cd(np.linspace(left, right, 181) + right_off, up + up_off)
        for name, (left, right, up, *_) in limits.items()
    }
    return {
        name
        for name, cd in found.items()
        if not (limits[name][3] <= cd.min() and cd.max() <= limits[name][4])
    }


def test_low_beam_is_a_passing_beam_of_un_regulation_149():
    assert not failing(LOW, PASSING)
    assert LOW.intensity_cd([-8, 0, 8], 4.0).sum() >= 190
    assert LOW.intensity_cd([-4, 0, 4], 2.0).sum() >= 375
    near = LOW.intensity_cd(np.linspace(-4.5, 2, 40)[:, None], np.linspace(-15, -4, 60))
    assert near.max() <= 0.8 * LOW.intensity_cd(1.72, -0.86)  # the foreground is no brighter than the road


def test_zone_iii_is_dark_but_on_its_border_along_the_horizon():
    """Up to 682 of 625 cd from 3 degrees left to the centre; a twentieth of a degree higher the limit holds."""
    border = [(-8, 1), (-8, 4), (8, 4), (8, 2), (6, 1.5), (1.5, 1.5), (0, 0), (-4, 0)]
    ends = np.array([*border, border[0]], float)
    share = np.linspace(0, 1, 41)[:, None]
    along = np.concatenate([one + (other - one) * share for one, other in pairwise(ends)])
    found = LOW.intensity_cd(*along.T)
    assert found.max() == pytest.approx(682, abs=1)
    right, up = along[found > 625].T
    assert up.max() < 0.05
    assert -3 < right.min() < right.max() < 0.05
    assert (LOW.intensity_cd(along[:, 0], along[:, 1] + 0.05) <= 625).all()


def test_low_beam_keeps_the_limits_of_fmvss_108_but_one():
    """366 of 500 cd half a degree above 1 degree right, where lamps of UN regulations are darker than American ones;
    an aim a quarter of a degree lower, which the rule allows, has them all the same."""
    assert failing(LOW, LOWER) == {"0.5U-1R to 3R"}
    assert LOW.intensity_cd(1.0, 0.5) == pytest.approx(366, abs=1)
    assert LOW.intensity_cd(1.0, 0.25) >= 500
    up, around = np.arange(10.0, 91.0), np.arange(-90.0, 91.0)[:, None]
    assert LOW.intensity_cd(around, up).max() <= 125


def test_high_beam_keeps_the_limits_of_fmvss_108():
    assert not failing(HIGH, UPPER)


def test_high_beam_is_a_driving_beam_of_un_regulation_149_but_at_two_points():
    """Its centre has .77 of the brightest, in place of .8, and 9 degrees left has 3201 of 3400 cd, within the quarter
    of a degree that the regulation tolerates along either axis."""
    assert not failing(HIGH, DRIVING)
    brightest = HIGH.intensity_cd(np.linspace(-5, 5, 201)[:, None], np.linspace(-4, 3, 141)).max()
    assert 40500 <= brightest <= 215000
    assert HIGH.intensity_cd(0.0, 0.0) / brightest == pytest.approx(0.774, abs=1e-3)
    assert HIGH.intensity_cd(-9.0, 0.0) == pytest.approx(3201, abs=1)
    assert HIGH.intensity_cd([-8.75, 9.0], [-0.25, 0.0]).min() >= 3400


def test_stray_light_falls_as_that_of_a_measured_lamp():
    """10 degrees to the left, where an IES file of a lamp has been published (pastebin.com/TkWWMhvZ), within 20 %."""
    measured = {0: 563, 1: 246, 2: 132, 3: 114, 5: 78, 7: 59}
    np.testing.assert_allclose(LOW.intensity_cd(-10.0, [*measured]), [*measured.values()], rtol=0.2)
