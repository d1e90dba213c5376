"""Scenes: bodies, groups, layouts and where an episode starts."""
