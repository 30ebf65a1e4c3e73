"""The explorer: one picture as a camera would take it, what it measures and what a detector finds, while
sliders move.

``state`` says what is looked at, ``controls`` what can be moved, ``looking`` what is seen there; ``page``
shows it in a browser and is the only part that needs the extra ``[explore]``.
"""
