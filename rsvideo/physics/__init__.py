"""How a rolling-shutter camera writes a frame."""
