"""Sensors: pure functions from `Transition` to readings, over N worlds."""
