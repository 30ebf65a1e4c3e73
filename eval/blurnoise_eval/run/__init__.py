"""A sweep: its work, its run folder, its exports."""
