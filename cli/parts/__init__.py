"""The longer parts of commands, between their options and their texts."""
