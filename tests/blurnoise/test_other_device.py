"""Pictures on a device that is not the CPU: results stay there and are the CPU's."""

import json
import subprocess
import sys

import other_device
import pytest
from other_device import CALLS, PRESETS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def results():
    """In a process of its own, whose PyTorch knows the device."""
    return json.loads(subprocess.check_output([sys.executable, other_device.__file__]))


@pytest.mark.parametrize("name", [*CALLS, *PRESETS])
def test_results_stay_on_the_device_and_are_the_cpu_s(results, name):
    """Constants made on the CPU would not mix with the picture. Rounding may move a digital number by one."""
    within = 1.0 if name in PRESETS else 0.01
    assert results[name].get("device") == "card", results[name]
    assert results[name]["differs"] <= within


MOST_WAITS = {
    "motion_blur": 3,
    "numbers on the device": 16,
    "headlamps": 24,
    "RandomExposure": 46,
}
"""For checks that all is finite and within limits, for the lengths of transforms, and for the plan of a picture."""


@pytest.mark.parametrize("name", CALLS)
def test_a_call_waits_for_few_values_of_the_device(results, name):
    """Each wait ends what a GPU does ahead. More of them than today need a reason."""
    assert 0 < results[name]["waited"] <= MOST_WAITS[name]
