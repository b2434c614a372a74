"""What stands in files beside the pictures: sidecars, recorded motion, and how files are read and written."""
