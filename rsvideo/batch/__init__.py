"""Many clips and photographs: the requests, what they come to, the work on all cores, and a ledger that survives anything."""
