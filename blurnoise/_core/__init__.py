"""What the simulator's rooms share: guards, random fields, threads, scratch memory, borders, transforms."""
