"""How fast and how exact this machine simulates: commands, never tests. One room per bench.

``chain``: one picture through the whole chain. ``sweeps``: a sweep beside bare onnxruntime. ``blur``: every
way to blur by motion, time beside error; its yardstick is ``truth``, its competitors stand in ``contenders``.
"""
