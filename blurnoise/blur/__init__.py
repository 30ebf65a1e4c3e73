"""Blur: pictures by the lens, by motion of any kind, and by objects before each other."""

from blurnoise.blur.convolution import motion_blur as motion_blur
