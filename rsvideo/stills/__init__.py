"""Photographs as files hold them, read into linear light and written back as they came."""
