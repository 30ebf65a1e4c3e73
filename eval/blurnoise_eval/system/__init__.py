"""The machine: threads, files that appear whole, tables."""
