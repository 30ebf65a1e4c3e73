"""Threads: each of pytest-xdist's processes has one. With more, those of all wait for each other at every loop."""

import os

import hypothesis

hypothesis.settings.register_profile("untimed", deadline=None)  # nothing is said of a busy machine
hypothesis.settings.load_profile("untimed")

if "PYTEST_XDIST_WORKER" in os.environ:  # PyTorch reads it when it is imported
    os.environ.setdefault("OMP_NUM_THREADS", "1")
