"""Image quality of charts and pictures, and comparison of simulated with real ones."""
