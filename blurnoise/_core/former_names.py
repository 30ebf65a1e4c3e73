"""Former names of modules that README and guide had; importing one works for one release, with a warning."""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

_FORMER = {
    "metrics.information": "metrics.edge_information",
    "metrics.patches": "metrics.contrast metrics.noise metrics.similarity",
    "metrics.values": "metrics.estimate",
    "motion.ego": "driving ego_motion",
    "motion.trajectory": "camera_shake motion.causes",
    "optics.camera": "capture",
    "optics.colour": "encoding",
    "optics.transfer": "transfer",
    "scene.cutting": "mattes",
    "scene.hdr": "hdr",
    "training.augmentation": "augment",
    "training.ranges": "exposure_ranges",
    "training.table": "exposure_table",
    "training.torchvision": "augment_torchvision",
}
FORMER = {f"blurnoise.{old}": f"blurnoise.{new}" for new, names in _FORMER.items() for old in names.split()}


class _FormerNames(MetaPathFinder, Loader):
    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in FORMER else None

    def exec_module(self, module: ModuleType) -> None:
        new = FORMER[module.__name__]
        warnings.warn(f"{module.__name__} is {new} now", DeprecationWarning, stacklevel=2)
        names = vars(importlib.import_module(new))
        vars(module).update({name: value for name, value in names.items() if not name.startswith("__")})


def register() -> None:
    """Have former names found, after all present ones."""
    sys.meta_path.append(_FormerNames())
