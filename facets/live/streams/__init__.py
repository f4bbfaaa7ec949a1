"""What goes out of a run: samples for other programs."""
