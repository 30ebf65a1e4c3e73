"""Threads: each of pytest-xdist's processes has one. With more, those of all wait for each other at every loop."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:  # PyTorch reads it when it is imported
    os.environ.setdefault("OMP_NUM_THREADS", "1")
