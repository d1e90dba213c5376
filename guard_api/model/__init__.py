"""Robots: the neutral model, its readers, its reference dynamics and the library of shipped robots."""
