"""Many clips: what is asked for, what it comes to, the work on all cores, and a ledger that survives anything."""
