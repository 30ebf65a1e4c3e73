"""The paper that this project starts from, rerun: Lin et al., Sensors 2024, 24(16), 5135."""
