"""How requests, sidecars and quantities are written, and how files are read and written."""
