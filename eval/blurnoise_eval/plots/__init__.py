"""Figures of matplotlib and pictures with boxes; nothing here knows of a run."""
