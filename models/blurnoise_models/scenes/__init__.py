"""Synthetic street and room pictures with labelled stop signs: what the default detector is trained on."""

from blurnoise_models.scenes.compose import Scene, scene, write_coco

__all__ = ["Scene", "scene", "write_coco"]
