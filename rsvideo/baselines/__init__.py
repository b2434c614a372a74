"""What people would otherwise reach for, done as well as it can be: the other side of every comparison."""
