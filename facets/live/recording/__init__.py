"""A recording: the folder that a run writes, and that a replay reads."""
