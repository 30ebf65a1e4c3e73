"""A trial of a model's file, as a program: whether it opens and answers to a picture, within bounded memory and
time.

It ends with 0, or with 2 and a line that says what is wrong.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np

from blurnoise_eval.datasets import Picture
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.scoring.on_picture import view
from blurnoise_eval.system.terminal import say

MOST_BYTES = 12 << 30


def main(path: str, most_cpu_s: int) -> int:
    """Try the file for so many seconds of computing; returns the exit code."""
    resource.setrlimit(resource.RLIMIT_CPU, (most_cpu_s, most_cpu_s + 5))
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    grey = np.full((96, 128, 3), 128, np.uint8)
    try:
        (model,) = open_models([Path(path)])
        answer = view(model, Picture("grey", None, lambda: grey, "grey"), grey).clean
    except Exception as error:  # whatever a file makes libraries raise
        say(" ".join(str(error).split())[:400] or type(error).__name__)
        return 2
    if answer.error:
        say(answer.error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2])))
