"""Training pictures as cameras would take them: conditions to draw from, and augmentations that draw."""
