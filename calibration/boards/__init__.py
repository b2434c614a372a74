"""Calibration boards: named, printed and found in pictures."""
