"""Your own camera: its figures from dark and flat frames, or from what a DNG file states."""
