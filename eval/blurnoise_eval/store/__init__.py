"""The results of a run in one SQLite file."""
