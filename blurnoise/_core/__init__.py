"""Shared helpers: checks, random fields, threads, scratch memory, borders, transforms."""
