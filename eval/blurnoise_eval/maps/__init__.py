"""Maps: which image-quality metric tells how well a detector does, over light and blur together."""
