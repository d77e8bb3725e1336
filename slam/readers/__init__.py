"""Readers of recorded logs: each turns a file into `slam.measurements.Measurement`s."""
