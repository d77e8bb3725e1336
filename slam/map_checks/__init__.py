"""What a finished map is asked, and lets go of or is failed for: loops, breaks, wheels, drift."""
