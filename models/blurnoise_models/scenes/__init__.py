"""Synthetic street and room pictures with labelled stop signs: what the default detector is trained on."""

from blurnoise_models.scenes.compose import Scene, scene, scenes, write_coco

__all__ = ["Scene", "scene", "scenes", "write_coco"]
