"""Measures a camera: lens, readout time and response."""
