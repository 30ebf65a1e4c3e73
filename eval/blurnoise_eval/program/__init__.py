"""Exposure programs: from the light on the scene to exposure and gain, for a mix of speeds."""
