"""Networks in the installed ``rapidocr`` package: only its files are used, not its code."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def rapidocr_models() -> tuple[Path, Path] | None:
    """Return the files (text detection, recognition) in ``rapidocr`` or, before it, ``rapidocr-onnxruntime``.

    None where neither is installed, or where the one that is keeps no networks in its package.
    """
    for package in ("rapidocr", "rapidocr_onnxruntime"):
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            detection, recognition = (
                sorted(Path(folder, "models").glob(f"*_{task}_*.onnx")) for task in ("det", "rec")
            )
            if detection and recognition:
                return detection[-1], recognition[-1]
    return None
