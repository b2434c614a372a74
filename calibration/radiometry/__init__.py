"""How codes stand for light, from an exposure series."""
