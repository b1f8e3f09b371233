"""Ground that others laid out, each in a file: what is judged there, and what stands beside it."""
