"""Scenes and their exposures: simulation, metering and the error budget."""
