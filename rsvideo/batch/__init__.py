"""Many clips and photographs: what is asked for, what it comes to, the work on all cores, and a ledger that survives anything."""
