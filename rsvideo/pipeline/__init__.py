"""From file to file: reading, timing, restoring and writing, in order."""
