"""Several methods on one input: carried out, decoded to one measure, and gathered for a report."""
