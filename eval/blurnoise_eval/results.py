"""A run folder: what makes two runs the same run, and everything in it that a report shows."""

from __future__ import annotations

import hashlib
import os
import platform
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from blurnoise.camera import Camera
from blurnoise_eval.conditions import Plan
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.onnx_model import Detector
from blurnoise_eval.optimum import answers
from blurnoise_eval.report import RunData
from blurnoise_eval.store import Store, StoreError

_PACKAGES = ("blurnoise", "torch", "kornia", "onnxruntime", "numpy", "opencv-contrib-python-headless")


def open_run(
    store: Store, detector: Detector, camera: Camera, pictures: PictureSet, plan: Plan, facts: dict[str, Any]
) -> None:
    """Note in the store what the run is; a store that holds another run is refused.

    ``facts``: what else the report shows (command, threads). Raises :class:`StoreError` that lists what
    differs.
    """
    identity = {
        "model": {"sha256": detector.sha256, "contract": _without_sources(detector.contract.to_dict())},
        "camera": _without_sources(camera.to_dict()),
        "plan": plan.to_dict(),
        "pictures": [picture.identity for picture in pictures],
        "choice of targets": _digest(repr([picture.targets for picture in pictures])),
    }
    identity = _as_json(identity)
    held = store.about("identity")
    if held is not None and held != identity:
        differing = [key for key in identity if held.get(key) != identity[key]]
        raise StoreError(
            f"run = {str(store.folder)!r}: holds a run with another {' and '.join(differing)}; "
            "choose another folder, or repeat that run's command to resume it"
        )
    store.set_about("identity", identity)
    contract = detector.contract.to_dict()
    store.set_about(
        "manifest",
        {
            "title": f"{detector.name} seen through {camera.name}",
            "model": {
                "name": detector.name,
                "file": str(detector.path),
                "sha256": detector.sha256,
                "contract": {**contract, "input_size_px": list(detector.input_size_px)},
            },
            "camera": camera.to_dict(),
            "images": {"kind": pictures.kind, "source": pictures.source, "count": len(pictures)},
            "seed": plan.seed,
            "versions": {name: metadata.version(name) for name in _PACKAGES},
            "hardware": hardware(),
            **facts,
        },
    )


def hardware() -> dict[str, Any]:
    """The machine in words: processor, usable cores, operating system, Python."""
    return {
        "processor": _processor(),
        "cores": usable_cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def usable_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def read_run(store: Store, *, threshold: float) -> RunData:
    """Everything that the report of this run shows. Raises :class:`StoreError` for a run that never began."""
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    targets = store.targets()
    cells = store.cells()
    manifest = {**manifest, "threshold": threshold, "warnings": _warnings(cells, store.skipped())}
    return RunData(
        manifest=manifest,
        cells=cells,
        targets=targets,
        skipped=store.skipped(),
        answers=[
            {**asdict(answer), "windows_s": [list(window) for window in answer.windows_s]}
            for answer in answers(targets, threshold)
        ],
        examples=_examples(store, cells, targets, manifest["model"]["contract"]["classes"]),
    )


def _examples(
    store: Store, cells: list[dict[str, Any]], targets: list[dict[str, Any]], classes: list[str]
) -> list[dict[str, Any]]:
    by_cell: dict[str, list[dict[str, Any]]] = {}
    for row in targets:
        box = [row[edge] for edge in ("x0", "y0", "x1", "y1")]
        shown = {"box_xyxy": box, "label": row["label"], "confidence": row["confidence"]}
        by_cell.setdefault(row["cell_id"], []).append(shown)
    examples = []
    for cell in cells:
        if cell["example"] is None:
            continue
        found = store.detections(cell["cell_id"])
        rows = zip(found.boxes_xyxy.tolist(), found.scores.tolist(), found.class_ids.tolist(), strict=True)
        examples.append(
            {
                **cell,
                "path": str(store.folder / cell["example"]),
                "detections": [
                    {"box_xyxy": box, "score": score, "label": classes[class_id]}
                    for box, score, class_id in rows
                ],
                "targets": by_cell.get(cell["cell_id"], []),
            }
        )
    return examples


def _warnings(cells: list[dict[str, Any]], skipped: list[dict[str, Any]]) -> list[str]:
    without = {cell["image"] for cell in cells if cell["clean"] and cell["n_targets"] == 0}
    if not without:
        return []
    return [
        f"{len(without)} pictures have no target that the model knows; they count for no curve "
        f"(first: {min(without)})"
    ]


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "backslashreplace"), digest_size=16).hexdigest()


def _without_sources(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(entry) for key, entry in value.items()}
    return [_as_json(entry) for entry in value] if isinstance(value, (list, tuple)) else value


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
