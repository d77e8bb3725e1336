"""How recorded logs are asked, by name. The command's help reads this: nothing heavy in here."""

PROTOCOLS = ("tracked", "each", "jumps")
"""Of `kitasap real-log`: from a known start; scan by scan, no start; teleported, no start."""
DEFAULT_METHOD = {"real-log": "open3d", "localize": "limit"}
"""By command, whatever the protocol."""
