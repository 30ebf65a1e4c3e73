"""Image quality of charts, simulated and photographed."""
