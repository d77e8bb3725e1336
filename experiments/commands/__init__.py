"""The commands of `kitasap`, by what they are about. Heavy imports wait within them."""
