"""Cameras: their lens, pixels and converter, light and colours."""
