"""The paper's trials on the simulated robot, the same pipelines on real logs, and their figures."""
