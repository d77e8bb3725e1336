"""The regression gate: a run held against a stored baseline, by tests with a stated error rate."""
