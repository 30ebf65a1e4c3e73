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
