"""Answers: from scores under many conditions to exposures, windows and models, each with its uncertainty."""
