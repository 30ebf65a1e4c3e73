"""Scores: what a model finds under one condition, held against what is there."""
