"""Figures and measures of what was done to a picture."""
