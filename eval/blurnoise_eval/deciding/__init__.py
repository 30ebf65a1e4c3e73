"""Deciding what exposure works from few calls: the plane's nodes, its surface, the search, and what it answers."""
