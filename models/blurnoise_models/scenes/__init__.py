"""Synthetic street and room pictures with labelled stop signs: what the default detector is trained on."""

from blurnoise_models.scenes.compose import DrawnScene, scene, write_coco

__all__ = ["DrawnScene", "scene", "write_coco"]
