"""How recorded logs are asked, by name. The command's help reads this: nothing heavy in here."""

PROTOCOLS = ("tracked", "each", "jumps")
"""Of `kitasap real-log`: from a known start; scan by scan, no start; teleported, no start."""
DEFAULT_METHOD = {"real-log": "open3d", "localize": "limit"}
"""By command, whatever the protocol."""

REAL_LOG_FILES = {
    "real_logs": ("trajectory.tum", "localization.png", "localization.svg"),
    "real_relocalization_each": ("asked.jsonl",),
    "real_relocalization_jumps": ("asked.jsonl",),
}
"""Beside summary.json, by what that calls the experiment: one protocol's do not stay beside
another's."""
