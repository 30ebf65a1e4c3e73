"""Benches of this machine, how fast and how exact it simulates: commands, never tests. One room per bench.

``chain``: the whole chain and its stages, beside other libraries. ``sweeps``: a sweep beside bare onnxruntime.
``blur``: every way to blur by motion, time beside error; its yardstick is ``truth``, its competitors stand in
``contenders``. ``noise``: every way to draw noise, time beside distance; its yardstick is ``laws``, its
competitors stand in ``samplers``. ``motion``: every way to
move an object, a picture, its rows or its road, time beside error; its yardstick is ``motion_truth``, a job stands in
each of ``motion_objects``, ``motion_paths``, ``motion_rows`` and ``motion_road``.
"""
