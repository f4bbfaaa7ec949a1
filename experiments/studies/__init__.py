"""Studies and drawings that no command needs. They run in a checkout; the wheel lacks them."""
