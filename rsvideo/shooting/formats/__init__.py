"""Cameras as other programs write them down, read into profiles and written from them."""
