"""The evaluation harness: runs a detector over simulated exposures and reports what it can still see."""
