"""Worked examples, to be read from top to bottom; each runs: `python -m experiments.examples.<name>`."""
