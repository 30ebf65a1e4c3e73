"""Measurement of cameras: figures from dark and flat frames, DNG files, tuning files and brackets."""
