"""The explorer: a page of sliders beside the picture that a camera takes, and what a detector finds in it.

Only ``server`` needs the extra ``[explore]``.
"""
