"""Anybody's detectors and text recognisers: contracts, files, detections."""
