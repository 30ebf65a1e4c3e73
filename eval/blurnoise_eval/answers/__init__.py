"""Scores: detections against targets, curves, exposure windows."""
