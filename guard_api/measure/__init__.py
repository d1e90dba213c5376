"""Measurement: rollouts, statistics, the transfer matrix and its report."""
