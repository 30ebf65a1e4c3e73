"""Former names of modules, which work for one release: to import one warns, and gives the new one's names."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType

FORMER = {
    "blurnoise.augment": "blurnoise.training.augmentation",
    "blurnoise.augment_torchvision": "blurnoise.training.torchvision",
    "blurnoise.auto_exposure": "blurnoise.scene.metering",
    "blurnoise.binning": "blurnoise.optics.camera",
    "blurnoise.camera": "blurnoise.optics.camera",
    "blurnoise.camera_files": "blurnoise.optics.camera_files",
    "blurnoise.camera_shake": "blurnoise.motion.causes",
    "blurnoise.capture": "blurnoise.optics.gains",
    "blurnoise.colour": "blurnoise.optics.colour",
    "blurnoise.cut_scene": "blurnoise.scene.cut_scene",
    "blurnoise.distortion": "blurnoise.optics.distortion",
    "blurnoise.driving": "blurnoise.motion.ego",
    "blurnoise.ego_motion": "blurnoise.motion.ego",
    "blurnoise.encoding": "blurnoise.optics.colour",
    "blurnoise.error_budget": "blurnoise.scene.plan",
    "blurnoise.exposed_with": "blurnoise.scene.exposure",
    "blurnoise.exposure": "blurnoise.scene.scene",
    "blurnoise.exposure_ranges": "blurnoise.training.ranges",
    "blurnoise.exposure_table": "blurnoise.training.table",
    "blurnoise.field": "blurnoise.optics.lens",
    "blurnoise.field_blur": "blurnoise.blur.over_the_field",
    "blurnoise.flow_blur": "blurnoise.blur.sub_exposures",
    "blurnoise.fourier": "blurnoise.blur.fourier",
    "blurnoise.gain": "blurnoise.optics.gains",
    "blurnoise.grey_anchor": "blurnoise.scene.metering",
    "blurnoise.hdr": "blurnoise.scene.hdr",
    "blurnoise.layered": "blurnoise.blur.layered",
    "blurnoise.layers": "blurnoise.blur.layers",
    "blurnoise.lens": "blurnoise.optics.lens",
    "blurnoise.mattes": "blurnoise.scene.cutting",
    "blurnoise.moving_masks": "blurnoise.scene.cutting",
    "blurnoise.operating_point": "blurnoise.light.conditions",
    "blurnoise.path_blur": "blurnoise.blur.paths",
    "blurnoise.psf": "blurnoise.blur.psf",
    "blurnoise.radiometry": "blurnoise.optics.radiometry",
    "blurnoise.resampling": "blurnoise.blur.resampling",
    "blurnoise.simulation": "blurnoise.scene.scene",
    "blurnoise.spectra": "blurnoise.optics.spectra",
    "blurnoise.stated_trajectory": "blurnoise.motion.causes",
    "blurnoise.tone": "blurnoise.optics.colour",
    "blurnoise.trajectory": "blurnoise.motion.trajectory",
    "blurnoise.transfer": "blurnoise.optics.transfer",
    "blurnoise.transfer_of_paths": "blurnoise.blur.transfer_of_paths",
}


class _FormerNames(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        return importlib.machinery.ModuleSpec(fullname, self) if fullname in FORMER else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        new = FORMER[module.__name__]
        warnings.warn(f"{module.__name__} is {new} now", DeprecationWarning, stacklevel=2)
        names = vars(importlib.import_module(new))
        vars(module).update({name: value for name, value in names.items() if not name.startswith("__")})


def register() -> None:
    """Have former names found, after all that is there."""
    if not any(isinstance(finder, _FormerNames) for finder in sys.meta_path):
        sys.meta_path.append(_FormerNames())
