"""The detector that comes with the package: a trained :class:`~blurnoise_models.network.SignNet` for stop signs.

``blurnoise train -o DIR`` makes such a file; its metadata says how this one was made.
"""

from __future__ import annotations

from pathlib import Path

STOP_SIGN = Path(__file__).with_name("stop_sign.onnx")
"""Finds stop signs from about 16 px on in pictures letterboxed to 320 px; contract inside. See ``export``."""
THRESHOLD = 0.5
"""Scores from here on count as found: at most one false alarm in ten photographs without signs."""
