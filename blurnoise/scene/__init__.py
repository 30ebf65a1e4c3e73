"""Scenes and their exposures: what is simulated of them, metered and planned."""
