"""The readout time, from a flickering light, from hand-held footage, from published numbers."""
