"""Run time against error, beside what a user would write without this package."""
