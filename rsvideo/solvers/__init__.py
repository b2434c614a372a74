"""How to invert: arrays in, arrays out, no camera."""
