"""Bits that a change of the code's shape must not change; tests/helpers/frozen.py writes them anew."""

import json

import frozen
import pytest

HELD = json.loads(frozen.HELD.read_text())


def changed(kind):
    now = frozen.computed(kind)
    return {name for name in HELD[kind].keys() | now.keys() if HELD[kind].get(name) != now.get(name)}


@pytest.mark.slow
def test_frames_have_the_bits_they_had():
    assert changed("frames") == set()


@pytest.mark.slow
def test_runs_have_the_ids_headers_and_answers_they_had():
    if frozen.processor() != HELD["processor"]:  # scores of onnxruntime differ in their last bits
        pytest.skip("the frozen runs were computed on another processor")
    assert changed("runs") == set()
