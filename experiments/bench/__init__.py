"""`kitasap bench`: how fast and how true the parts are, measured here and now."""
