"""The explorer: one picture as a camera would take it, what it measures and what a detector finds, while sliders
move.

``state``: what is shown, and the controls; ``catalogue``: what there is; ``rendered``: the picture and its scores;
``page``, ``charts`` and ``server`` show it in a browser, the only part that needs the extra ``[explore]``.
"""
