"""Where each scan lies, seen from the last ones: a verdict on every step, wheels believed or not."""
