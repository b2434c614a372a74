"""Removes motion blur and rolling-shutter distortion together, from ordinary hand-held footage."""
