"""The explorer: a picture as a camera would take it, and what a detector finds in it, while sliders move.

Only ``page``, ``charts`` and ``server`` need the extra ``[explore]``.
"""
